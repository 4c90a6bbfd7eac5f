#pragma once

#include <Eigen/Core>
#include <set>
#include <vector>

#include "s3lam/base/id.h"
#include "s3lam/geometry/rigid3.h"

namespace s3lam {

/// What is known of an image's pose before any adjustment. A sigma of zero: not known.
struct PosePrior {
  ImageId image_id;
  Rigid3 cam_from_world;
  double sigma_position = 0.0;  // Of the camera's centre, each axis [map units]
  double sigma_rotation = 0.0;  // About each axis [rad]
};

/// Two planes of the semantic map are parallel and known to be so far apart.
struct PlaneDistance {
  PlaneId a, b;
  double distance = 0.0;  // [map units; of the pose priors' world, if that is another]
  double sigma = 0.0;     // [map units]
};

/// What an adjustment must not change, or must keep near to.
struct Constraints {
  std::set<ImageId> constant_images;
  std::set<PointId> constant_points;
  std::vector<PosePrior> pose_priors;  // Ascending image id, at most one per image.
  std::vector<PlaneDistance> plane_distances;
};

}  // namespace s3lam
