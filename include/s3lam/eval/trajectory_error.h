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
#include "s3lam/geometry/similarity3.h"
#include "s3lam/scene/trajectory.h"

namespace s3lam {

/// What of the difference between estimate and ground truth is free: a similarity (a monocular
/// estimate), a rigid transform, nothing.
enum class TrajectoryAlignment { kSim3, kSe3, kNone };

/// "sim3", "se3", "none".
std::optional<TrajectoryAlignment> TrajectoryAlignmentFromName(std::string_view name);
std::string_view TrajectoryAlignmentName(TrajectoryAlignment alignment);

struct TrajectoryErrorOptions {
  TrajectoryAlignment align = TrajectoryAlignment::kSim3;
  double max_dt_s = 0.02;
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

/// Lengths are in the ground truth's unit, angles in degrees.
struct TrajectoryErrors {
  TrajectoryErrorOptions options;
  size_t num_estimate = 0;  // Poses in each trajectory.
  size_t num_ground_truth = 0;
  size_t num_pairs = 0;
  double path_length = 0.0;  // Of the ground truth, over the associated poses.
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

/// Associates, aligns the camera centres (Umeyama) and measures, by the definitions of the TUM
/// benchmark and of evo. Empty if fewer than three poses are associated or (with alignment) their
/// centres leave the rotation undetermined.
std::optional<TrajectoryErrors> CompareTrajectories(const Trajectory& estimate,
                                                    const Trajectory& ground_truth,
                                                    const TrajectoryErrorOptions& options = {});

nlohmann::json ToJson(const Similarity3& a_from_b);
nlohmann::json ToJson(const TrajectoryErrors& errors);
/// A few aligned lines for people.
std::string ToTable(const TrajectoryErrors& errors);

}  // namespace s3lam
