#include "s3lam/base/statistics.h"

#include <gtest/gtest.h>

#include <cmath>

namespace s3lam {
namespace {

TEST(Statistics, MedianIsTheUpperOne) {
  EXPECT_EQ(Median({}), 0.0);
  EXPECT_EQ(Median({3.0}), 3.0);
  EXPECT_EQ(Median({4.0, 1.0, 2.0}), 2.0);
  EXPECT_EQ(Median({4.0, 1.0, 2.0, 3.0}), 3.0);
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
