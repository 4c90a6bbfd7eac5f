#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/eval/error_statistics.h"
#include "s3lam/eval/pose_errors.h"
#include "s3lam/eval/time_offset.h"
#include "s3lam/eval/trajectory_alignment.h"
#include "s3lam/geometry/similarity3.h"
#include "s3lam/scene/trajectory.h"

namespace s3lam {

struct TrajectoryErrorOptions {
  TrajectoryAlignment align = TrajectoryAlignment::kSim3;
  double max_dt_s = 0.02;
  double time_offset_s = 0.0;
  bool estimate_time_offset = false;
  double max_time_offset_s = 0.2;
  int rpe_delta_frames = 1;
  double rpe_delta_m = 1.0;
  std::vector<double> segment_lengths_m = {100, 200, 300, 400, 500, 600, 700, 800};
  int segment_step_frames = 10;

  void Visit(OptionVisitor& v);
};

/// Index pairs (a, b) of poses that are nearest to each other in time and at most `max_dt_s` [s]
/// apart; no pose is in two pairs. Ascending.
std::vector<std::pair<size_t, size_t>> AssociateByTime(const Trajectory& a, const Trajectory& b,
                                                       double max_dt_s);

/// What allowing for an offset between the clocks changes, see TimeOffset.
struct TimeOffsetEffect {
  bool is_estimated = false;         // Else it was given.
  std::optional<TimeOffset> offset;  // Empty if it cannot be told: all errors are without one.
  size_t num_pairs_without = 0;
  std::optional<double> ate_rmse_without;  // Empty where poses pair up with an offset only.
  /// What poses without any error would be off by, compared without the offset.
  std::optional<double> ate_rmse_of_exact;
  std::optional<TimeOffset> of_rotations;  // If an offset was asked for and can be told by them.
};

/// Lengths are in the ground truth's unit, angles in degrees.
struct TrajectoryErrors {
  TrajectoryErrorOptions options;
  size_t num_estimate = 0;  // Poses in each trajectory.
  size_t num_ground_truth = 0;
  size_t num_pairs = 0;
  std::optional<TimeOffsetEffect> time_offset;  // If one was given or asked for.
  double path_length = 0.0;                     // Of the ground truth, over the associated poses.
  Similarity3 truth_from_estimate;
  /// Absolute trajectory error (Sturm et al. 2012): distance of the camera centres, and angle of
  /// the rotations, after alignment.
  ErrorStatistics ate_translation;
  ErrorStatistics ate_rotation_deg;
  Eigen::Vector3d ate_rmse_per_axis = Eigen::Vector3d::Zero();   // Along the axes of the truth.
  Eigen::Vector3d ate_rmse_in_camera = Eigen::Vector3d::Zero();  // Of the true camera.
  double ate_rmse_along = 0.0;                                   // In the direction of travel.
  double ate_rmse_across = 0.0;
  /// Relative pose error of consecutive poses (rpe_delta_frames apart), all of them.
  ErrorStatistics rpe_translation;
  ErrorStatistics rpe_rotation_deg;
  /// Of poses rpe_delta_m apart on the true way, over that way.
  RelativeErrors rpe_per_length;
  /// KITTI's measure; no rows if the way is shorter than the shortest segment.
  SegmentErrorTable segments;
  /// Per pair.
  std::vector<PoseError> poses;
};

/// Associates (with a time offset: interpolates the ground truth), aligns the camera centres
/// (Umeyama) and measures, by the definitions of the TUM benchmark and of evo. Empty if fewer than
/// three poses are associated or (with alignment) their centres leave the rotation undetermined.
std::optional<TrajectoryErrors> CompareTrajectories(const Trajectory& estimate,
                                                    const Trajectory& ground_truth,
                                                    const TrajectoryErrorOptions& options = {});

nlohmann::json ToJson(const Similarity3& a_from_b);
nlohmann::json ToJson(const TrajectoryErrors& errors);
/// A few aligned lines for people.
std::string ToTable(const TrajectoryErrors& errors);

}  // namespace s3lam
