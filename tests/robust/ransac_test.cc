#include "s3lam/robust/ransac.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace s3lam {
namespace {

constexpr double kSquaredThreshold = 4.0;

/// Places on a line; a model is where most of them are.
class PlaceEstimator {
 public:
  using Model = double;
  static constexpr size_t kSampleSize = 1;
  static constexpr RansacLoss kLoss = RansacLoss::kOverScales;

  explicit PlaceEstimator(std::vector<double> places) : places_(std::move(places)) {}

  [[nodiscard]] size_t size() const { return places_.size(); }
  [[nodiscard]] std::array<size_t, 1> DrawSample(Rng& rng) const {
    return DrawUniformSample<1>(size(), rng);
  }
  void Estimate(const std::array<size_t, 1>& sample, std::vector<double>& models) const {
    models.push_back(places_[sample[0]]);
  }
  [[nodiscard]] double SquaredError(double model, size_t i) const {
    return std::pow(places_[i] - model, 2);
  }
  [[nodiscard]] std::optional<double> Refine(double model, std::span<const size_t> inliers) const {
    double sum = 0.0;
    double total = 0.0;
    for (const size_t i : inliers) {
      const double weight = LossWeight(kLoss, SquaredError(model, i), kSquaredThreshold);
      sum += weight * places_[i];
      total += weight;
    }
    if (!(total > 0.0)) return std::nullopt;
    return sum / total;
  }

 private:
  std::vector<double> places_;
};

/// Places about 0 and 3, a few more about 0, among others anywhere.
std::vector<double> TwoHeaps() {
  Rng rng(5);
  std::vector<double> places;
  for (int i = 0; i < 120; ++i) places.push_back(rng.Gaussian(0.0, 0.8));
  for (int i = 0; i < 110; ++i) places.push_back(rng.Gaussian(3.0, 0.8));
  for (int i = 0; i < 300; ++i) places.push_back(rng.Uniform(-50.0, 50.0));
  return places;
}

/// The score that a search with the seed ends in.
double ScoreWith(uint64_t seed, const RansacOptions& options) {
  Rng rng(seed);
  const auto result =
      Ransac(PlaceEstimator(TwoHeaps()), std::sqrt(kSquaredThreshold), options, rng);
  return result ? result->score : std::numeric_limits<double>::infinity();
}

double ScoreOf(const PlaceEstimator& estimator, double model) {
  double score = 0.0;
  for (size_t i = 0; i < estimator.size(); ++i) {
    score += LossOf(RansacLoss::kOverScales, estimator.SquaredError(model, i), kSquaredThreshold);
  }
  return score;
}

TEST(RansacLoss, IsTheMeanOverTheNoise) {
  constexpr int kSteps = 20000;
  for (const double squared : {0.0, 0.01, 0.2, 0.25, 1.0, 2.5, 3.9}) {
    double mean = 0.0;
    for (int i = 0; i < kSteps; ++i) {
      const double noise = kLeastNoise + (1.0 - kLeastNoise) * (i + 0.5) / kSteps;
      mean += std::min(squared / (noise * noise), kSquaredThreshold) / kSteps;
    }
    EXPECT_NEAR(LossOf(RansacLoss::kOverScales, squared, kSquaredThreshold), mean, 1e-4) << squared;
  }
}

TEST(RansacLoss, IsTheThresholdForOutliers) {
  for (const RansacLoss loss : {RansacLoss::kTruncated, RansacLoss::kOverScales}) {
    for (const double squared : {4.0, 5.0, std::numeric_limits<double>::infinity(),
                                 std::numeric_limits<double>::quiet_NaN()}) {
      EXPECT_EQ(LossOf(loss, squared, kSquaredThreshold), kSquaredThreshold);
      EXPECT_EQ(LossWeight(loss, squared, kSquaredThreshold), 0.0);
    }
    EXPECT_NEAR(LossOf(loss, 4.0 - 1e-9, kSquaredThreshold), kSquaredThreshold, 1e-6);
  }
}

TEST(RansacLoss, HasItsDerivativeForWeight) {
  constexpr double kStep = 1e-6;
  for (const RansacLoss loss : {RansacLoss::kTruncated, RansacLoss::kOverScales}) {
    const double at_none = LossOf(loss, kStep, kSquaredThreshold) / kStep;
    for (const double squared : {0.1, 0.3, 1.0, 3.0}) {
      const double slope = (LossOf(loss, squared + kStep, kSquaredThreshold) -
                            LossOf(loss, squared - kStep, kSquaredThreshold)) /
                           (2.0 * kStep);
      EXPECT_NEAR(
          LossWeight(loss, squared, kSquaredThreshold) / LossWeight(loss, 0.0, kSquaredThreshold),
          slope / at_none, 1e-6)
          << squared;
    }
  }
}

TEST(Ransac, EndsInABetterModelTheMoreSamplesAreRefined) {
  RansacOptions of_one;
  of_one.min_iterations = 12;
  of_one.max_iterations = 12;
  RansacOptions of_several = of_one;
  of_several.refined_samples = 8;
  int better = 0;
  for (uint64_t seed = 1; seed <= 40; ++seed) {
    const double score = ScoreWith(seed, of_several);
    EXPECT_LE(score, ScoreWith(seed, of_one)) << seed;
    better += score < ScoreWith(seed, of_one);
  }
  EXPECT_GT(better, 5);
}

TEST(SpreadOrder, HasEveryIndexOnce) {
  for (const size_t n : {1U, 2U, 3U, 10U, 48U, 97U, 1000U}) {
    std::vector<size_t> order = internal::SpreadOrder(n);
    std::sort(order.begin(), order.end());
    ASSERT_EQ(order.size(), n);
    for (size_t i = 0; i < n; ++i) EXPECT_EQ(order[i], i);
  }
}

TEST(SpreadOrder, SpreadsItsFirstPart) {
  const std::vector<size_t> order = internal::SpreadOrder(1000);
  std::vector<size_t> first(order.begin(), order.begin() + 50);
  std::sort(first.begin(), first.end());
  for (size_t i = 1; i < first.size(); ++i) EXPECT_LE(first[i] - first[i - 1], 60U);
}

TEST(ScoreBelow, IsTheScoreOrNothing) {
  const PlaceEstimator estimator(TwoHeaps());
  const std::vector<size_t> order = internal::SpreadOrder(estimator.size());
  const double limit = 1.1 * ScoreOf(estimator, 0.0);
  int kept = 0;
  for (double model = -10.0; model < 10.0; model += 0.1) {
    const double score = ScoreOf(estimator, model);
    const auto below = internal::ScoreBelow(estimator, model, kSquaredThreshold, limit, order);
    // By a part of the data alone nothing is refused that is far below the limit.
    if (score < 0.95 * limit) {
      EXPECT_TRUE(below) << model;
    }
    if (!below) continue;
    EXPECT_NEAR(*below, score, 1e-9);
    EXPECT_LT(*below, limit);
    ++kept;
  }
  EXPECT_GT(kept, 5);
  EXPECT_LT(kept, 150);
}

TEST(RansacIterations, FollowsTheFormula) {
  RansacOptions options;
  options.min_iterations = 1;
  options.max_iterations = 100000;
  options.confidence = 0.99;
  EXPECT_EQ(RansacIterations(0.5, 3, options), 35);  // log(0.01) / log(1 - 0.125) = 34.5
  EXPECT_EQ(RansacIterations(1.0, 3, options), 1);
  EXPECT_EQ(RansacIterations(0.0, 3, options), 100000);
}

TEST(DrawUniformSample, DrawsDifferentIndices) {
  Rng rng(7);
  for (int i = 0; i < 100; ++i) {
    const auto sample = DrawUniformSample<3>(3, rng);
    EXPECT_EQ(sample[0] + sample[1] + sample[2], 3U);
    EXPECT_NE(sample[0], sample[1]);
  }
}

}  // namespace
}  // namespace s3lam
