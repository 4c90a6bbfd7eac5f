#include "s3lam/base/error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "s3lam/base/id.h"
#include "s3lam/base/timer.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

TEST(Check, NamesFileLineConditionAndMessage) {
  const int n = 3;
  S3LAM_CHECK(n == 3);
  EXPECT_THAT([&] { S3LAM_CHECK(n == 4); }, ThrowsMessage<std::logic_error>(AllOf(
                                                HasSubstr("error_test.cc"), HasSubstr("n == 4"))));
  EXPECT_THAT(
      [&] { S3LAM_CHECK_MSG(n == 4, "n is {}", n); },
      ThrowsMessage<std::logic_error>(AllOf(HasSubstr("error_test.cc"), HasSubstr("n is 3"))));
}

TEST(Id, InvalidIsTheLargestValue) {
  EXPECT_FALSE(PointId().valid());
  EXPECT_FALSE(kInvalidImageId.valid());
  EXPECT_TRUE(PointId(0).valid());
  EXPECT_EQ(kInvalidPointId.value(), ~uint64_t{0});
  EXPECT_LT(ImageId(1), ImageId(2));
}

TEST(ScopedStep, AddsUpByName) {
  StepTimes times;
  { const ScopedStep step(times, "a"); }
  const double once = times.at("a");
  { const ScopedStep step(times, "a"); }
  EXPECT_EQ(times.size(), 1u);
  EXPECT_GE(once, 0.0);
  EXPECT_GT(times.at("a"), once);
}

TEST(PeakMemory, IsPlausible) {
  EXPECT_GT(PeakMemoryMiB(), 1.0);
  EXPECT_LT(PeakMemoryMiB(), 1e6);
}

}  // namespace
}  // namespace s3lam
