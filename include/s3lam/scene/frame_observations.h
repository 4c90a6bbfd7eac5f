#pragma once

#include <Eigen/Core>
#include <vector>

#include "s3lam/base/id.h"

namespace s3lam {

/// A keypoint of a frame that sees a point of the model.
struct FrameObservation {
  PointId point_id;
  Eigen::Vector2f xy = Eigen::Vector2f::Zero();  // px in the original image, first pixel at 0.5
  float sigma = 1.0F;                            // Standard deviation of xy, both axes [px]
};

/// What a frame that is no image of the model sees of the model's points.
struct ObservedFrame {
  double time_s = 0.0;
  CameraId camera_id;
  std::vector<FrameObservation> observations;
};

/// Frames by strictly increasing time.
using FrameObservations = std::vector<ObservedFrame>;

}  // namespace s3lam
