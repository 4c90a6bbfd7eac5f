#include "s3lam/base/statistics.h"

#include <gtest/gtest.h>

#include <cmath>

namespace s3lam {
namespace {

TEST(Statistics, MediansDifferForAnEvenNumberOfValues) {
  const std::vector<double> four{4.0, 1.0, 3.0, 2.0};
  EXPECT_EQ(Median(four), 3.0);
  EXPECT_EQ(InterpolatedMedian(four), 2.5);
  const std::vector<double> three{3.0, 1.0, 2.0};
  EXPECT_EQ(Median(three), 2.0);
  EXPECT_EQ(InterpolatedMedian(three), 2.0);
  EXPECT_EQ(Median({}), 0.0);
  EXPECT_EQ(InterpolatedMedian({}), 0.0);
}

TEST(Statistics, RootMeanSquare) {
  EXPECT_EQ(RootMeanSquare({}), 0.0);
  EXPECT_DOUBLE_EQ(RootMeanSquare({3.0, -4.0}), std::sqrt(12.5));
}

TEST(Statistics, UpperQuantileHasTheShareBelowIt) {
  EXPECT_EQ(UpperQuantile({4.0, 1.0, 2.0, 3.0}, 0.0), 1.0);
  EXPECT_EQ(UpperQuantile({4.0, 1.0, 2.0, 3.0}, 0.75), 4.0);
}

TEST(Statistics, MedianStepIsOfSuccessiveValues) {
  EXPECT_EQ(MedianStep({}), 0.0);
  EXPECT_EQ(MedianStep({7.0}), 0.0);
  EXPECT_EQ(MedianStep({1.0, 2.0, 4.0, 14.0}), 2.0);
}

TEST(Statistics, RayleighQuantileOfOneHalfIsItsMedian) {
  EXPECT_NEAR(RayleighQuantile(0.5), kMedianOfRayleigh, 1e-12);
}

}  // namespace
}  // namespace s3lam
