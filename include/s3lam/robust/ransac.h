#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <numeric>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/base/rng.h"

namespace s3lam {

struct RansacOptions {
  int min_iterations = 50;
  int max_iterations = 2000;
  double confidence = 0.999;
  int refined_samples = 1;

  void Visit(OptionVisitor& v) {
    v.Value("min_iterations", min_iterations, "Samples drawn at least.", 1);
    v.Value("max_iterations", max_iterations, "Samples drawn at most.", 1);
    v.Value("confidence", confidence, "Probability of having drawn an all-inlier sample.", 0.0,
            1.0 - 1e-9);
    v.Value("refined_samples", refined_samples,
            "Of the samples' models, how many of the best are refined: the more, the less the "
            "result depends on which samples were drawn.",
            1, 1000);
  }
};

/// What a datum with the squared residual r^2 costs, up to the threshold T^2.
enum class RansacLoss {
  kTruncated,   // r^2 (MSAC).
  kOverScales,  // The mean of that over the noise, from a quarter of what is said to all of it.
};

/// The least noise of kOverScales, of what is said.
inline constexpr double kLeastNoise = 0.25;

inline double LossOf(RansacLoss loss, double squared, double squared_threshold) {
  if (!(squared < squared_threshold)) return squared_threshold;
  if (loss == RansacLoss::kTruncated) return squared;
  if (squared < kLeastNoise * kLeastNoise * squared_threshold) return squared / kLeastNoise;
  // With less noise than r / T a datum is an outlier, with more it costs r^2 / noise^2.
  return (2.0 * std::sqrt(squared * squared_threshold) - squared -
          kLeastNoise * squared_threshold) /
         (1.0 - kLeastNoise);
}

/// Weight of a datum in a least squares step: the derivative of the loss by the squared residual.
inline double LossWeight(RansacLoss loss, double squared, double squared_threshold) {
  if (!(squared < squared_threshold)) return 0.0;
  if (loss == RansacLoss::kTruncated) return 1.0;
  const double ratio = std::max(kLeastNoise, std::sqrt(squared / squared_threshold));
  return (1.0 / ratio - 1.0) / (1.0 - kLeastNoise);
}

/// What a model estimator offers to Ransac. Residuals are in units of their own standard deviation,
/// so the inlier threshold has no unit.
template <typename E>
concept RansacEstimator = requires(const E& estimator, const typename E::Model& model,
                                   std::array<size_t, E::kSampleSize> sample,
                                   std::vector<typename E::Model>& models,
                                   std::span<const size_t> inliers, Rng& rng) {
  { E::kLoss } -> std::convertible_to<RansacLoss>;
  /// Number of data.
  { estimator.size() } -> std::convertible_to<size_t>;
  /// Indices of a minimal sample.
  { estimator.DrawSample(rng) } -> std::convertible_to<std::array<size_t, E::kSampleSize>>;
  /// Appends the models through a sample; none if it is degenerate.
  estimator.Estimate(sample, models);
  /// Squared residual of one datum, in squared standard deviations.
  { estimator.SquaredError(model, size_t{}) } -> std::convertible_to<double>;
  /// The best model of these inliers, near the given one; empty if they leave it undetermined.
  { estimator.Refine(model, inliers) } -> std::convertible_to<std::optional<typename E::Model>>;
};

template <typename Model>
struct RansacResult {
  Model model;
  double score = 0.0;           // Sum of the losses, lower is better.
  std::vector<size_t> inliers;  // Ascending.
  int iterations = 0;
};

/// `K` different indices below n, uniformly; n >= K.
template <size_t K>
std::array<size_t, K> DrawUniformSample(size_t n, Rng& rng) {
  std::array<size_t, K> sample{};
  for (size_t i = 0; i < K; ++i) {
    do {
      sample[i] = rng.Below(n);
    } while (std::find(sample.begin(), sample.begin() + i, sample[i]) != sample.begin() + i);
  }
  return sample;
}

/// Samples needed so that one of them holds inliers only, with the given confidence.
inline int RansacIterations(double inlier_ratio, size_t sample_size, const RansacOptions& options) {
  const double hit = std::pow(std::clamp(inlier_ratio, 0.0, 1.0), static_cast<double>(sample_size));
  double needed = options.max_iterations;
  if (hit >= 1.0) {
    needed = 1.0;
  } else if (hit > 0.0) {
    needed = std::ceil(std::log1p(-options.confidence) / std::log1p(-hit));
  }
  return static_cast<int>(
      std::clamp(needed, static_cast<double>(options.min_iterations),
                 std::max<double>(options.min_iterations, options.max_iterations)));
}

namespace internal {

/// All indices below n, so that any first part of them is spread over all.
inline std::vector<size_t> SpreadOrder(size_t n) {
  constexpr double kGoldenSection = 0.6180339887498949;
  auto stride = static_cast<size_t>(kGoldenSection * static_cast<double>(n)) | 1U;
  while (std::gcd(stride, n) != 1) ++stride;
  std::vector<size_t> order;
  for (size_t i = 0; i < n; ++i) order.push_back(i * stride % n);
  return order;
}

/// The score of a model; empty as soon as it will not be below the limit, or most probably not: by
/// three standard deviations of what the data looked at so far say.
template <typename Estimator>
std::optional<double> ScoreBelow(const Estimator& estimator, const typename Estimator::Model& model,
                                 double squared_threshold, double limit,
                                 const std::vector<size_t>& order) {
  constexpr size_t kFirstLook = 48;
  constexpr double kSigmas = 3.0;
  const auto all = static_cast<double>(order.size());
  double sum = 0.0;
  double squares = 0.0;
  size_t next_look = kFirstLook;
  for (size_t k = 0; k < order.size(); ++k) {
    const double loss =
        LossOf(Estimator::kLoss, estimator.SquaredError(model, order[k]), squared_threshold);
    sum += loss;
    squares += loss * loss;
    if (!(sum < limit)) return std::nullopt;
    if (k + 1 < next_look) continue;
    const auto count = static_cast<double>(k + 1);
    const double mean = sum / count;
    const double variance = std::max(0.0, squares / count - mean * mean);
    // The data not looked at yet scatter about their sum with the sum's own error.
    const double sigma = std::sqrt(variance * all * (all - count) / count);
    if (!(mean * all - kSigmas * sigma < limit)) return std::nullopt;
    next_look *= 2;
  }
  return sum;
}

template <typename Estimator>
std::vector<size_t> FindInliers(const Estimator& estimator, const typename Estimator::Model& model,
                                double squared_threshold) {
  std::vector<size_t> inliers;
  for (size_t i = 0; i < estimator.size(); ++i) {
    if (estimator.SquaredError(model, i) < squared_threshold) inliers.push_back(i);
  }
  return inliers;
}

/// Refits to the inliers as long as that lowers the score.
template <typename Estimator>
void RefineLocally(const Estimator& estimator, double squared_threshold,
                   const std::vector<size_t>& order,
                   RansacResult<typename Estimator::Model>& best) {
  constexpr int kMaxRefinements = 10;
  for (int i = 0; i < kMaxRefinements; ++i) {
    const auto refined = estimator.Refine(best.model, best.inliers);
    if (!refined) return;
    const auto score = ScoreBelow(estimator, *refined, squared_threshold, best.score, order);
    if (!score) return;
    best.model = *refined;
    best.score = *score;
    best.inliers = FindInliers(estimator, best.model, squared_threshold);
  }
}

/// The best models among those that samples gave and that were not refined yet.
template <typename Model>
class RunnersUp {
 public:
  explicit RunnersUp(size_t capacity) : capacity_(capacity) {}

  /// The score from which on a model is not kept.
  [[nodiscard]] double Limit() const {
    if (models_.size() < capacity_) return std::numeric_limits<double>::max();
    return models_.empty() ? std::numeric_limits<double>::lowest() : models_.back().first;
  }
  void Add(double score, const Model& model) {
    if (!(score < Limit())) return;
    if (models_.size() == capacity_) models_.pop_back();
    const auto at = std::find_if(models_.begin(), models_.end(),
                                 [&](const auto& other) { return score < other.first; });
    models_.insert(at, {score, model});
  }
  [[nodiscard]] const std::vector<std::pair<double, Model>>& models() const { return models_; }

 private:
  size_t capacity_;
  std::vector<std::pair<double, Model>> models_;  // By score, the lowest first.
};

/// A model with its inliers, refined; empty if it has fewer than a sample.
template <typename Estimator>
std::optional<RansacResult<typename Estimator::Model>> Refined(
    const Estimator& estimator, const typename Estimator::Model& model, double score,
    double squared_threshold, const std::vector<size_t>& order) {
  RansacResult<typename Estimator::Model> result{
      model, score, FindInliers(estimator, model, squared_threshold), 0};
  if (result.inliers.size() < Estimator::kSampleSize) return std::nullopt;
  RefineLocally(estimator, squared_threshold, order, result);
  return result;
}

}  // namespace internal

/// RANSAC with the estimator's loss and local refinement (Chum et al. 2003) of every new best
/// model, at the end also of the next best ones. `threshold` is in standard deviations. Empty if
/// there are fewer data than a sample needs, or no sample gave a model with as many inliers.
template <RansacEstimator Estimator>
std::optional<RansacResult<typename Estimator::Model>> Ransac(const Estimator& estimator,
                                                              double threshold,
                                                              const RansacOptions& options,
                                                              Rng& rng) {
  using Model = typename Estimator::Model;
  if (estimator.size() < Estimator::kSampleSize) return std::nullopt;
  const double squared_threshold = threshold * threshold;
  const std::vector<size_t> order = internal::SpreadOrder(estimator.size());
  std::optional<RansacResult<Model>> best;
  internal::RunnersUp<Model> runners_up(static_cast<size_t>(options.refined_samples - 1));
  std::vector<Model> models;
  int needed = options.max_iterations;
  int iteration = 0;
  for (; iteration < std::max(needed, options.min_iterations); ++iteration) {
    models.clear();
    estimator.Estimate(estimator.DrawSample(rng), models);
    for (const Model& model : models) {
      const double limit =
          best ? std::max(best->score, runners_up.Limit()) : std::numeric_limits<double>::max();
      const auto score = internal::ScoreBelow(estimator, model, squared_threshold, limit, order);
      if (!score) continue;
      if (best && !(*score < best->score)) {
        runners_up.Add(*score, model);
        continue;
      }
      auto refined = internal::Refined(estimator, model, *score, squared_threshold, order);
      if (!refined) continue;
      best = std::move(refined);
      const double ratio =
          static_cast<double>(best->inliers.size()) / static_cast<double>(estimator.size());
      needed = RansacIterations(ratio, Estimator::kSampleSize, options);
    }
  }
  for (const auto& [score, model] : runners_up.models()) {
    auto refined = internal::Refined(estimator, model, score, squared_threshold, order);
    if (refined && refined->score < best->score) best = std::move(refined);
  }
  if (best) best->iterations = iteration;
  return best;
}

}  // namespace s3lam
