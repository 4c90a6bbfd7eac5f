#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "s3lam/base/id.h"
#include "s3lam/geometry/camera.h"
#include "s3lam/geometry/rigid3.h"
#include "s3lam/geometry/similarity3.h"

namespace s3lam {

using Rgb = std::array<uint8_t, 3>;

/// A keypoint of an image and the scene point it observes, if any.
struct Point2D {
  Eigen::Vector2d xy = Eigen::Vector2d::Zero();  // px in the original image, first pixel at 0.5
  PointId point_id = kInvalidPointId;
};

struct Image {
  ImageId id;
  CameraId camera_id;
  std::string name;  // Relative to the image folder, as COLMAP has it.
  Rigid3 cam_from_world;
  std::vector<Point2D> points2D;
};

/// One observation of a point: points2D[point2D_index] of an image.
struct TrackElement {
  ImageId image_id;
  uint32_t point2D_index = 0;
  auto operator<=>(const TrackElement&) const = default;
};

struct ScenePoint {
  Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
  Rgb color{};
  double error = -1.0;  // Mean reprojection error [px]; negative if not computed.
  std::vector<TrackElement> track;
};

/// Cameras, posed images, points and tracks: what a COLMAP model holds. Ids are ordered, so every
/// loop over it is deterministic.
struct Reconstruction {
  std::map<CameraId, Camera> cameras;
  std::map<ImageId, Image> images;
  std::map<PointId, ScenePoint> points;

  [[nodiscard]] const Camera& CameraOf(const Image& image) const {
    return cameras.at(image.camera_id);
  }
  [[nodiscard]] size_t NumObservations() const;
};

/// Throws InputError naming `source` unless cameras, images, points and tracks refer to each other
/// consistently (both ways), and all numbers are finite.
void CheckReconstruction(const Reconstruction& reconstruction, const std::string& source);

/// Sets every point's error to its mean reprojection error [px]. An observation from behind (or one
/// that cannot be projected) counts as the image diagonal.
void UpdatePointErrors(Reconstruction& reconstruction);

/// Root mean square of all reprojection errors [px] (observations from behind left out) and the
/// mean over points of the points' mean errors, which is what `colmap model_analyzer` prints.
struct ReprojectionStatistics {
  double rms_px = 0.0;
  double mean_px = 0.0;
  size_t num_observations = 0;
  size_t num_behind = 0;
};
ReprojectionStatistics ComputeReprojectionStatistics(const Reconstruction& reconstruction);

/// Moves everything into another world: points, poses.
void TransformReconstruction(const Similarity3& new_from_old, Reconstruction& reconstruction);

/// Median over all observations of the point's depth in the camera [map units]; 0 without any.
double MedianDepth(const Reconstruction& reconstruction);

}  // namespace s3lam
