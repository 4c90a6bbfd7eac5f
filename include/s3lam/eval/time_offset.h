#pragma once

#include <optional>
#include <vector>

#include "s3lam/eval/pose_errors.h"
#include "s3lam/eval/trajectory_alignment.h"
#include "s3lam/scene/trajectory.h"

namespace s3lam {

/// Poses of a trajectory at any time: positions on cubic Hermite curves through its own (with the
/// slopes of finite differences over both neighbours), rotations by slerp.
class PoseInterpolator {
 public:
  /// Two poses farther apart than three times the usual (median) interval are not bridged. The
  /// trajectory must outlive this.
  explicit PoseInterpolator(const Trajectory& trajectory);

  /// world_from_camera; empty outside the trajectory and where it has a gap.
  [[nodiscard]] std::optional<Rigid3> At(double time_s) const;
  /// Whether there are poses at all times from `from_s` to `to_s`.
  [[nodiscard]] bool Covers(double from_s, double to_s) const;

 private:
  [[nodiscard]] bool IsBridged(size_t i) const;  // From pose i to pose i + 1.
  [[nodiscard]] Eigen::Vector3d SlopeAt(size_t i) const;

  const Trajectory& trajectory_;
  double max_gap_s_ = 0.0;
};

/// How far the clock of the ground truth is ahead of the estimate's: what the estimate has at time
/// t the truth has at t + offset.
struct TimeOffset {
  double offset_s = 0.0;
  double sigma_s = 0.0;
};

/// Every pose of the estimate that the truth covers at its time + `offset_s`, with the truth there.
std::vector<PosePair> PairPosesAtOffset(const Trajectory& estimate, const Trajectory& ground_truth,
                                        double offset_s);

/// The offset of at most `max_offset_s` that, with the alignment for it, leaves the smallest
/// distances of the camera centres. Its standard error is that of the linearised least squares with
/// the errors of ten successive parts of the sequence as the independent ones, since those of
/// successive poses are not. Empty if the smallest distances are at the limit, if the motion does
/// not tell an offset from the alignment (as a straight and even one), or if the standard error is
/// larger than the limit.
std::optional<TimeOffset> EstimateTimeOffset(const Trajectory& estimate,
                                             const Trajectory& ground_truth,
                                             TrajectoryAlignment alignment, double max_offset_s);

/// The same by the angular velocities from pose to pose, whose axes may be those of another body
/// (an IMU) in the truth. Drift hardly matters to it, positions do not at all: where both offsets
/// differ, the truth has its positions from another clock than its rotations. Empty also if the
/// rotations are all about one axis.
std::optional<TimeOffset> EstimateTimeOffsetOfRotations(const Trajectory& estimate,
                                                        const Trajectory& ground_truth,
                                                        double max_offset_s);

}  // namespace s3lam
