#pragma once

#include <optional>
#include <string>
#include <vector>

#include "s3lam/eval/trajectory_error.h"
#include "s3lam/geometry/similarity3.h"
#include "s3lam/report/run_folder.h"

namespace s3lam::report {

/// One arm's trajectory against the truth.
struct ArmErrors {
  double rmse = 0.0;
  std::vector<double> time_s;  // Since the first true pose.
  std::vector<double> error;   // ATE [truth's unit].
  std::vector<Eigen::Vector3d> position_in_view;
};

/// The frame all pictures are drawn in: z is up, x is the longer side of the map, the origin is in
/// the map's middle. Up is the normal of the largest horizontal plane, or without one the cameras'
/// mean upward direction.
struct CommonFrame {
  std::vector<Similarity3>
      view_from_arm;              // Scaled like the truth, or without it like the last arm.
  std::vector<ArmErrors> errors;  // Per arm; empty without a truth to compare with.
  std::vector<Eigen::Vector3d> truth_in_view;
  std::string unit;  // Of lengths, for axes and tables.
  std::string note;  // Why there is no comparison although a truth was given; else empty.
};

CommonFrame MakeCommonFrame(const RunFolder& run, const Trajectory& truth,
                            const TrajectoryErrorOptions& options);

}  // namespace s3lam::report
