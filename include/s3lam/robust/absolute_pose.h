#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "s3lam/geometry/rigid3.h"

namespace s3lam {

struct AbsolutePose {
  Rigid3 cam_from_world;
  std::vector<uint8_t> is_inlier;
  int num_inliers = 0;
};

/// Pose of a calibrated camera from points in the world and where it sees them (normalised
/// coordinates), by P3P inside RANSAC (OpenCV's, whose own seed is fixed: `seed` is that of the
/// order in which it gets the points). `threshold` is in normalised units. Empty for fewer than
/// four points or when no sample gives a pose.
std::optional<AbsolutePose> EstimateAbsolutePose(std::span<const Eigen::Vector3d> points_in_world,
                                                 std::span<const Eigen::Vector2d> normalized,
                                                 double threshold, uint64_t seed);

}  // namespace s3lam
