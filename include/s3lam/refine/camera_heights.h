#pragma once

#include <Eigen/Core>
#include <map>
#include <string>

#include "s3lam/refine/ground.h"
#include "s3lam/refine/plane_model.h"
#include "s3lam/robust/plane_fit.h"

namespace s3lam {

/// Standard deviation of a camera's height over a plane fitted to points that may lie aside of it.
double HeightSigma(const PlaneFit& fit, const Eigen::Vector3d& center);

/// Standard deviation over the mean; zero for no values.
double RelativeSpread(const std::vector<double>& values);

/// Relative standard deviation of the cameras' heights over their ground planes; zero without any.
double HeightSpread(const BundleProblem& problem);

/// Holds the heights of the cameras against the map, between solves.
///
/// Keypoints share errors that no noise model has (calibration, rolling shutter), so bundle
/// adjustment is surer of its scale than it should be, by an unknown factor; how much the height of
/// a camera on wheels varies is known. So where the heights, as the ground's points alone tell
/// them, vary by more than can be explained, they and the ground's points are weighed more, until
/// the map follows. Drift of the scale follows. What does not follow, however it is weighed, is
/// contradicted by the reprojections: then the surface is not the ground, or the height not
/// constant.
class CameraHeights {
 public:
  CameraHeights(const CameraHeightOptions& options, const PlaneSigmaOptions& sigma, double sigma_px)
      : options_(options), sigma_(sigma), sigma_px_(sigma_px) {}

  /// After a solve: measures the heights; takes out of use planes that stand out and did not come
  /// nearer since the last call, with the heights over them, and starts again with the others;
  /// else raises the weights if need be (sigmas to a fifth at once, to a fiftieth in all, at most).
  void Update(PlaneModel& model, BundleProblem& problem);

  /// The heights vary by what can be explained; true before the first call.
  [[nodiscard]] bool Settled() const;

  /// Why the camera's height should not be held: the map, the weights raised, moved away from it or
  /// less than half of the way. Empty if it should.
  [[nodiscard]] std::string Doubts() const;
  [[nodiscard]] bool contradicted() const { return contradicted_; }

 private:
  const CameraHeightOptions& options_;
  const PlaneSigmaOptions& sigma_;
  double sigma_px_;
  std::map<int, double> deviations_;  // By plane, relative, at the last call.
  double first_excess_ = 0.0;         // Of the heights over what can be explained; 0: not measured.
  double last_excess_ = 0.0;
  double spread_ = 0.0;
  bool contradicted_ = false;
};

}  // namespace s3lam
