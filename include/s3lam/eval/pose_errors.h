#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "s3lam/eval/error_statistics.h"
#include "s3lam/geometry/rigid3.h"

namespace s3lam {

/// A pose of the ground truth and the estimate of it, aligned: both world_from_camera in one world.
struct PosePair {
  double time_s = 0.0;
  Rigid3 truth;
  Rigid3 estimate;
};

/// What is wrong with one pose, and where on the way. Lengths are in the truth's unit.
struct PoseError {
  double time_s = 0.0;                                   // Of the truth.
  double path = 0.0;                                     // Way of the truth up to here.
  Eigen::Vector3d difference = Eigen::Vector3d::Zero();  // Estimate minus truth, truth's axes.
  Eigen::Vector3d in_camera = Eigen::Vector3d::Zero();   // The same in the true camera's axes.
  double along = 0.0;   // Part in the direction of travel, positive if the estimate is ahead.
  double across = 0.0;  // Length of the rest.
  double rotation_deg = 0.0;
};
/// The direction of travel at a pose is from the pose before it to the pose after it.
std::vector<PoseError> ComputePoseErrors(std::span<const PosePair> pairs);

/// Relative pose errors: translation and angle of (Q_i^-1 Q_j)^-1 (P_i^-1 P_j), P the estimate, Q
/// the truth.
struct RelativeErrors {
  ErrorStatistics translation;
  ErrorStatistics rotation_deg;
};
/// j = i + delta for every i.
RelativeErrors RelativeErrorsOverFrames(std::span<const PosePair> pairs, size_t delta);
/// j is the first pose that is at least `delta` of the true way after i; both errors are divided by
/// the way between the two: unit per unit, degrees per unit.
RelativeErrors RelativeErrorsPerLength(std::span<const PosePair> pairs, double delta);

/// KITTI odometry's measure: mean relative error of all sub-sequences of one length, over it.
struct SegmentErrors {
  double length = 0.0;
  size_t count = 0;
  double translation_percent = 0.0;
  double rotation_deg_per_length = 0.0;
};
struct SegmentErrorTable {
  std::vector<SegmentErrors> by_length;  // Those that fit into the trajectory.
  SegmentErrors all;                     // Mean over the segments of all lengths; its length is 0.
};
/// As the benchmark's own program does it: segments start at every `step`-th pose and end at the
/// first pose more than the length farther along the true way.
SegmentErrorTable ComputeSegmentErrors(std::span<const PosePair> pairs,
                                       std::span<const double> lengths, size_t step);

/// "time_s,path,x,y,z,..." with a heading; `names` (none, or one per pose) become a first column.
std::string ToCsv(std::span<const PoseError> errors, std::span<const std::string> names = {});
nlohmann::json ToJson(std::span<const PoseError> errors, std::span<const std::string> names = {});
nlohmann::json ToJson(const SegmentErrorTable& table);
std::string ToTable(const SegmentErrorTable& table);

}  // namespace s3lam
