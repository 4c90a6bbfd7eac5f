#include "s3lam/base/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

namespace s3lam {
namespace {

TEST(Rng, IsSplitMix64) {
  // The published reference values for seed 1234567.
  Rng rng(1234567);
  for (const uint64_t expected :
       {6457827717110365317ULL, 3203168211198807973ULL, 9817491932198370423ULL}) {
    EXPECT_EQ(rng.Bits(), expected);
  }
}

TEST(Rng, SameSeedSameStream) {
  Rng a(5);
  Rng b(5);
  Rng c(6);
  bool differs = false;
  for (int i = 0; i < 10; ++i) {
    const double x = a.Gaussian();
    EXPECT_EQ(x, b.Gaussian());
    differs = differs || x != c.Gaussian();
  }
  EXPECT_TRUE(differs);
}

TEST(Rng, BelowIsUniform) {
  Rng rng(1);
  std::array<int, 7> counts{};
  constexpr int kDraws = 70000;
  for (int i = 0; i < kDraws; ++i) ++counts.at(rng.Below(7));
  // Six standard deviations of a binomial count.
  for (const int count : counts) EXPECT_NEAR(count, kDraws / 7.0, 6.0 * std::sqrt(kDraws / 7.0));
  EXPECT_EQ(rng.Below(1), 0u);
  EXPECT_ANY_THROW(rng.Below(0));
}

TEST(Rng, UniformStaysInItsInterval) {
  Rng rng(2);
  double sum = 0.0;
  for (int i = 0; i < 10000; ++i) {
    const double x = rng.Uniform(-2.0, 3.0);
    EXPECT_GE(x, -2.0);
    EXPECT_LT(x, 3.0);
    sum += x;
  }
  EXPECT_NEAR(sum / 10000, 0.5, 6.0 * 5.0 / std::sqrt(12.0 * 10000));
}

TEST(Rng, GaussianHasItsMoments) {
  Rng rng(3);
  constexpr int kDraws = 100000;
  double sum = 0.0;
  double squares = 0.0;
  int within_one_sigma = 0;
  for (int i = 0; i < kDraws; ++i) {
    const double x = rng.Gaussian(1.0, 2.0) - 1.0;
    ASSERT_TRUE(std::isfinite(x));
    sum += x;
    squares += x * x;
    within_one_sigma += std::abs(x) < 2.0;
  }
  EXPECT_NEAR(sum / kDraws, 0.0, 6.0 * 2.0 / std::sqrt(kDraws));
  EXPECT_NEAR(squares / kDraws, 4.0, 0.1);
  EXPECT_NEAR(within_one_sigma / static_cast<double>(kDraws), std::erf(std::sqrt(0.5)), 0.01);
}

TEST(Rng, SamplesAreDistinctAndFair) {
  Rng rng(4);
  for (const size_t count : {size_t{0}, size_t{3}, size_t{50}, size_t{100}}) {
    std::array<int, 100> hits{};
    for (int round = 0; round < 2000; ++round) {
      const std::vector<size_t> sample = rng.Sample(100, count);
      EXPECT_EQ(std::set<size_t>(sample.begin(), sample.end()).size(), count);
      for (const size_t i : sample) ++hits.at(i);
    }
    const double expected = 2000.0 * static_cast<double>(count) / 100.0;
    for (const int hit : hits) EXPECT_NEAR(hit, expected, 6.0 * std::sqrt(expected) + 1e-9);
  }
  EXPECT_ANY_THROW(rng.Sample(3, 4));
}

TEST(Rng, ForksAreIndependentAndLeaveTheParentAlone) {
  Rng rng(7);
  const Rng before = rng;
  std::set<uint64_t> first;
  for (uint64_t stream = 0; stream < 1000; ++stream) first.insert(rng.Fork(stream).Bits());
  EXPECT_EQ(first.size(), 1000u);
  EXPECT_EQ(rng.Fork(3).Bits(), Rng(7).Fork(3).Bits());
  EXPECT_EQ(rng.Bits(), Rng(before).Bits());
}

}  // namespace
}  // namespace s3lam
