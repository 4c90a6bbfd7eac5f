#pragma once

#include <ceres/ceres.h>

#include <array>
#include <optional>
#include <vector>

#include "s3lam/optim/self_calibration.h"

namespace s3lam {

/// Of all poses and points, and of what all observations have in common: the camera, or the readout
/// time of its shutter.
class CalibrationAdjustment {
 public:
  enum class Shared { kCamera, kReadout };
  CalibrationAdjustment(const SelfCalibrationOptions& options, const Camera& camera,
                        const CalibrationProblem& input, int min_length,
                        Shared shared = Shared::kCamera);

  /// Sigma of the first shared parameter over all others, which are free as well; empty if the
  /// normal equations cannot be solved.
  std::optional<double> SigmaOfFirstParam();

  /// See CameraRefinement.
  [[nodiscard]] double MeanScore();

  /// cam_from_world, as adjusted; `start` as of the problem.
  [[nodiscard]] std::vector<Rigid3> Poses(const std::vector<Rigid3>& start) const;
  [[nodiscard]] const std::vector<Eigen::Vector3d>& points() const { return points_; }

  [[nodiscard]] bool empty() const { return problem_.NumResidualBlocks() == 0; }
  [[nodiscard]] const Camera& camera() const { return camera_; }
  [[nodiscard]] double readout() const { return readout_; }
  void FreeReadout(bool is_free);

  /// Lets only these parameters of the camera vary; none: holds it and, for the gauge, the first
  /// pose.
  void FreeCamera(const std::vector<int>& free_params);

  void AddPrior(const FocalPrior& prior);

  struct Solution {
    double cost = 0.0;
    bool converged = false;
  };
  /// Empty if there is no usable solution.
  std::optional<Solution> Solve();

 private:
  static ceres::Problem::Options BorrowingLoss() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }

  [[nodiscard]] ceres::CostFunction* MakeCost(const CalibrationProblem::Observation& o,
                                              const Rigid3& pose) const;

  /// Null if there is none.
  [[nodiscard]] double* FirstPose();
  [[nodiscard]] double* SharedParams();

  const SelfCalibrationOptions& options_;
  Shared shared_;
  Camera camera_;
  double readout_ = 0.0;  // [s]
  std::vector<Eigen::Vector3d> points_;
  std::vector<std::array<double, 6>> poses_;
  ceres::HuberLoss loss_;  // Of the adjustment, even if nothing is observed.
  ceres::Problem problem_{BorrowingLoss()};
};

}  // namespace s3lam
