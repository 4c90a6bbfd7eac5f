#include "s3lam/refine/camera_heights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "s3lam/base/log.h"
#include "s3lam/base/statistics.h"

namespace s3lam {
namespace {

/// A plane stands out when its cameras' heights are off by so many times what the others are.
constexpr double kWrongSigmas = 3.0;
/// How far the heights may vary beyond what can be explained.
constexpr double kSettled = 1.2;
/// A deviation follows its weight if it falls below this part of what it was.
constexpr double kFollows = 0.99;
constexpr double kMaxFactor = 5.0;
constexpr double kMaxStrength = 500.0;

/// A camera's height by the points of its ground plane alone, over the common one.
struct MeasuredHeight {
  int plane = 0;
  double value = 0.0;
  double sigma = 0.0;
};

std::vector<MeasuredHeight> MeasureEach(const CameraHeightOptions& options,
                                        const PlaneSigmaOptions& sigma, double sigma_px,
                                        const PlaneModel& model, const BundleProblem& problem) {
  std::vector<MeasuredHeight> heights;
  int fitted = -1;
  std::optional<PlaneFit> fit;
  for (const HeightTerm& term : problem.heights) {
    if (term.plane != fitted) {
      fitted = term.plane;
      fit = FitMembers(sigma, sigma_px, model.planes[term.plane], model, problem);
    }
    if (!fit) continue;
    const Eigen::Vector3d center = problem.CenterOf(term.pose);
    heights.push_back(
        {term.plane, std::abs(fit->plane.SignedDistance(center)) / problem.height,
         std::hypot(options.sigma_relative, HeightSigma(*fit, center) / problem.height)});
  }
  return heights;
}

/// Relative deviations from the median height, in sigmas or as they are.
std::vector<double> Deviations(const std::vector<MeasuredHeight>& heights, bool in_sigmas) {
  std::vector<double> values;
  for (const MeasuredHeight& height : heights) values.push_back(height.value);
  const double median = Median(std::move(values));
  std::vector<double> deviations;
  for (const MeasuredHeight& height : heights) {
    deviations.push_back(std::abs(height.value / median - 1.0) / (in_sigmas ? height.sigma : 1.0));
  }
  return deviations;
}

/// Median over the cameras above each plane.
std::map<int, double> MedianByPlane(const std::vector<MeasuredHeight>& heights,
                                    const std::vector<double>& deviations) {
  std::map<int, std::vector<double>> of_plane;
  for (size_t i = 0; i < heights.size(); ++i) of_plane[heights[i].plane].push_back(deviations[i]);
  std::map<int, double> medians;
  for (auto& [plane, values] : of_plane) medians[plane] = Median(std::move(values));
  return medians;
}

/// The sigmas of the heights and of the ground's points fall by this factor.
void StrengthenGround(double factor, PlaneModel& model, BundleProblem& problem) {
  model.ground_strength *= factor;
  for (HeightTerm& term : problem.heights) term.sigma_relative /= factor;
}

/// What the ground is strengthened by where heights vary `excess` times as much as is explained:
/// the map gives way by less than in proportion.
double NextFactor(double excess, const PlaneModel& model) {
  return std::min({excess * excess, kMaxFactor, kMaxStrength / model.ground_strength});
}

void DropPlanes(const std::vector<int>& planes, PlaneModel& model, BundleProblem& problem) {
  for (const int plane : planes) {
    model.planes[plane].in_use = false;
    model.planes[plane].members.clear();
  }
  DropUnusedStructure(model, problem);
}

}  // namespace

double HeightSigma(const PlaneFit& fit, const Eigen::Vector3d& center) {
  const Eigen::Vector3d arm = center - fit.centroid;
  // d(distance) / d(rotations about u and v, shift), as PlaneFit::covariance has them.
  const Eigen::Vector3d lever(-fit.axis_v.dot(arm), fit.axis_u.dot(arm), -1.0);
  return std::sqrt(std::max(0.0, lever.dot(fit.covariance * lever)));
}

double RelativeSpread(const std::vector<double>& values) {
  if (values.empty()) return 0.0;
  double sum = 0.0;
  double squared = 0.0;
  for (const double value : values) {
    sum += value;
    squared += value * value;
  }
  const auto n = static_cast<double>(values.size());
  const double mean = sum / n;
  return std::sqrt(std::max(0.0, squared / n - mean * mean)) / mean;
}

double HeightSpread(const BundleProblem& problem) {
  std::vector<double> heights;
  for (const HeightTerm& term : problem.heights) {
    heights.push_back(
        problem.planes[term.plane].PlaneInWorld().SignedDistance(problem.CenterOf(term.pose)));
  }
  return RelativeSpread(heights);
}

void CameraHeights::Update(PlaneModel& model, BundleProblem& problem) {
  const std::vector<MeasuredHeight> heights =
      MeasureEach(options_, sigma_, sigma_px_, model, problem);
  if (heights.empty()) return;
  const std::vector<double> in_sigmas = Deviations(heights, true);
  const std::vector<double> relative = Deviations(heights, false);
  const std::map<int, double> sigmas = MedianByPlane(heights, in_sigmas);
  const std::map<int, double> deviations = MedianByPlane(heights, relative);
  const bool was_raised = model.ground_strength > 1.0;
  const double limit = kWrongSigmas * std::max(1.0, Median(in_sigmas) / kMedianOfAbsoluteNormal);
  std::vector<int> wrong;
  for (const auto& [plane, deviation] : deviations) {
    const auto before = deviations_.find(plane);
    if (was_raised && sigmas.at(plane) > limit && before != deviations_.end() &&
        deviation > kFollows * before->second) {
      wrong.push_back(plane);
    }
  }
  deviations_ = deviations;
  spread_ = RootMeanSquare(relative);
  const double excess = RootMeanSquare(in_sigmas);
  if (!wrong.empty()) {
    spdlog::info("{} of {} ground planes contradict the map: dropped", wrong.size(),
                 deviations.size());
    DropPlanes(wrong, model, problem);
    StrengthenGround(1.0 / model.ground_strength, model, problem);
    first_excess_ = last_excess_ = 0.0;
    return;
  }
  contradicted_ = excess > kSettled && was_raised && excess > kFollows * last_excess_;
  if (last_excess_ == 0.0) first_excess_ = excess;
  last_excess_ = excess;
  if (excess > kSettled && !contradicted_) {
    StrengthenGround(NextFactor(excess, model), model, problem);
  }
  spdlog::info("measured heights vary by {:.2f} %, {:.2f} times what is explained; strength {:.3g}",
               100.0 * spread_, excess, model.ground_strength);
}

bool CameraHeights::Settled() const { return last_excess_ <= kSettled; }

std::string CameraHeights::Doubts() const {
  const bool followed = last_excess_ <= std::max(kSettled, 0.5 * (first_excess_ + 1.0));
  if (followed && !contradicted_) return {};
  return fmt::format("by the ground's points it varies by {:.1f} %, and the map does not follow",
                     100.0 * spread_);
}

}  // namespace s3lam
