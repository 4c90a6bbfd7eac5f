#include "s3lam/optim/self_calibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "calibration_adjustment.h"
#include "s3lam/base/error.h"

namespace s3lam {
namespace {

constexpr int kNumParts = 5;  // Whose focal lengths are compared.

/// What the poses [begin, end) saw.
CalibrationProblem PartOf(const CalibrationProblem& problem, int begin, int end) {
  CalibrationProblem part;
  part.poses.assign(problem.poses.begin() + begin, problem.poses.begin() + end);
  std::vector<int> times_seen(problem.points.size(), 0);
  const auto is_inside = [&](const auto& o) { return o.pose >= begin && o.pose < end; };
  for (const auto& o : problem.observations) times_seen[o.point] += is_inside(o) ? 1 : 0;
  std::vector<int> index(problem.points.size(), -1);
  for (size_t i = 0; i < index.size(); ++i) {
    if (times_seen[i] < 2) continue;
    index[i] = static_cast<int>(part.points.size());
    part.points.push_back(problem.points[i]);
  }
  for (auto o : problem.observations) {
    if (!is_inside(o) || index[o.point] < 0) continue;
    o.pose -= begin;
    o.point = index[o.point];
    part.observations.push_back(o);
  }
  return part;
}

}  // namespace

void SelfCalibrationOptions::Visit(OptionVisitor& v) {
  v.Value("enabled", enabled,
          "check whether the calibration explains the images, and refine the lens distortion");
  v.Value("min_cost_decrease", min_cost_decrease,
          "share of the reprojection cost that a refined distortion must remove to be accepted",
          0.0, 1.0);
  v.Value(
      "max_observations", max_observations,
      "observations used, longest tracks first; more where a keyframe has fewer than 50 of them",
      100, 100000000);
  v.Value("max_iterations", max_iterations, "of each solve", 1, 1000);
}

Camera WithDistortion(const Camera& camera) {
  const bool simple =
      camera.model == CameraModel::kSimplePinhole || camera.model == CameraModel::kPinhole ||
      camera.model == CameraModel::kSimpleRadial || camera.model == CameraModel::kRadial;
  if (!simple) return camera;
  Camera result = camera;
  result.model = CameraModel::kOpenCv;
  result.params = {camera.FocalX(),
                   camera.FocalY(),
                   camera.PrincipalX(),
                   camera.PrincipalY(),
                   0.0,
                   0.0,
                   0.0,
                   0.0};
  if (camera.model == CameraModel::kSimpleRadial) result.params[4] = camera.params[3];
  if (camera.model == CameraModel::kRadial) {
    result.params[4] = camera.params[3];
    result.params[5] = camera.params[4];
  }
  return result;
}

SelfCalibrationReport CheckCalibration(const SelfCalibrationOptions& options, const Camera& camera,
                                       const CalibrationProblem& problem) {
  SelfCalibrationReport report;
  report.camera = camera;
  const Camera given = WithDistortion(camera);
  CalibrationAdjustment adjustment(options, given, problem, /*min_length=*/3);
  if (adjustment.empty()) return report;
  adjustment.FreeCamera({});
  const auto held = adjustment.Solve();
  // Of a solve that has not ended, the next one's gain would not be the distortion's.
  if (!held || !held->converged || held->cost <= 0.0) return report;
  // Tangential terms, freed, take up what bends in the map more than what the lens does.
  const std::vector<int> radial = CameraModelRadialParams(given.model);
  adjustment.FreeCamera(radial);
  const auto refined = adjustment.Solve();
  if (!refined) return report;
  report.cost_decrease = 1.0 - refined->cost / held->cost;
  report.accepted = report.cost_decrease >= options.min_cost_decrease;
  if (report.accepted) report.camera = adjustment.camera();

  // With the distortion, which takes up a part of what is wrong with them.
  std::vector<int> free_params = CameraModelPinholeParams(given.model);
  free_params.insert(free_params.end(), radial.begin(), radial.end());
  adjustment.FreeCamera(free_params);
  const auto pinhole = adjustment.Solve();
  if (!pinhole) return report;
  report.pinhole_cost_decrease = 1.0 - pinhole->cost / refined->cost;
  if (report.pinhole_cost_decrease >= kDoubtfulCostShare) {
    const Camera& better = adjustment.camera();
    report.better_pinhole = {better.FocalX(), better.FocalY(), better.PrincipalX(),
                             better.PrincipalY()};
  }
  return report;
}

std::string DescribeBetterPinhole(const std::vector<double>& better_pinhole, double cost_decrease) {
  return fmt::format(
      "focal lengths of {:.1f}, {:.1f} px and a principal point of ({:.1f}, {:.1f}) px, with a "
      "distortion to match, would remove {:.0f} % of the reprojection cost",
      better_pinhole[0], better_pinhole[1], better_pinhole[2], better_pinhole[3],
      100.0 * cost_decrease);
}

std::optional<CameraRefinement> RefineIntrinsics(const SelfCalibrationOptions& options,
                                                 const Camera& camera, const FocalPrior& prior,
                                                 const CalibrationProblem& problem) {
  S3LAM_CHECK(camera.model == CameraModel::kSimpleRadial || camera.model == CameraModel::kRadial);
  S3LAM_CHECK(prior.focal > 0.0 && prior.relative_sigma > 0.0);
  CalibrationAdjustment adjustment(options, camera, problem, /*min_length=*/2);
  if (adjustment.empty()) return std::nullopt;
  adjustment.AddPrior(prior);
  std::vector<int> all(camera.params.size());
  std::iota(all.begin(), all.end(), 0);
  adjustment.FreeCamera(all);
  if (!adjustment.Solve()) return std::nullopt;
  const auto sigma = adjustment.SigmaOfFirstParam();
  if (!sigma) return std::nullopt;
  CameraRefinement refinement;
  refinement.camera = adjustment.camera();
  refinement.focal_sigma = *sigma;
  refinement.mean_score = adjustment.MeanScore();
  refinement.poses = adjustment.Poses(problem.poses);
  refinement.points = adjustment.points();
  return refinement;
}

std::optional<ReadoutRefinement> RefineReadout(const SelfCalibrationOptions& options,
                                               const Camera& camera,
                                               const CalibrationProblem& problem) {
  CalibrationAdjustment adjustment(options, camera, problem, /*min_length=*/3,
                                   CalibrationAdjustment::Shared::kReadout);
  if (adjustment.empty()) return std::nullopt;
  adjustment.FreeReadout(false);
  const auto held = adjustment.Solve();
  if (!held || held->cost <= 0.0) return std::nullopt;
  adjustment.FreeReadout(true);
  const auto refined = adjustment.Solve();
  const auto sigma = refined ? adjustment.SigmaOfFirstParam() : std::nullopt;
  if (!sigma) return std::nullopt;
  return ReadoutRefinement{adjustment.readout(), *sigma, 1.0 - refined->cost / held->cost};
}

double FocalSigmaBetweenParts(const SelfCalibrationOptions& options, const Camera& camera,
                              const FocalPrior& prior, const CalibrationProblem& problem) {
  const int num_poses = static_cast<int>(problem.poses.size());
  std::vector<double> focals;
  std::vector<double> weights;
  for (int part = 0; part < kNumParts; ++part) {
    const auto refined = RefineIntrinsics(
        options, camera, prior,
        PartOf(problem, part * num_poses / kNumParts, (part + 1) * num_poses / kNumParts));
    if (!refined) continue;
    focals.push_back(refined->camera.FocalX());
    weights.push_back(1.0 / (refined->focal_sigma * refined->focal_sigma));
  }
  if (focals.size() < 2) return 0.0;
  const auto count = static_cast<Eigen::Index>(focals.size());
  const Eigen::Map<const Eigen::ArrayXd> f(focals.data(), count);
  const Eigen::Map<const Eigen::ArrayXd> w(weights.data(), count);
  const double sum = w.sum();
  const double mean = (w * f).sum() / sum;
  const double chi_square = (w * (f - mean).square()).sum();
  const double excess = std::max(0.0, chi_square - static_cast<double>(count - 1));
  const double variance = excess / (sum - w.square().sum() / sum);  // Between the parts.
  return std::sqrt(variance * w.square().sum()) / sum;
}

}  // namespace s3lam
