#include "s3lam/synthetic/texture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace s3lam {
namespace {

constexpr int kNumStyles = static_cast<int>(TextureStyle::kCarBody) + 1;

cv::Mat Paint(TextureStyle style, uint64_t seed, double size_m = 1.2, double texel_m = 0.003) {
  TextureSpec spec;
  spec.style = style;
  spec.seed = seed;
  spec.primary = {180, 150, 120};
  spec.secondary = {70, 60, 50};
  spec.texel_m = texel_m;
  return PaintTexture(spec, {size_m, size_m});
}

class EveryStyle : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Texture, EveryStyle, testing::Range(0, kNumStyles));

TEST_P(EveryStyle, IsAFunctionOfItsSeed) {
  const auto style = static_cast<TextureStyle>(GetParam());
  const cv::Mat a = Paint(style, 1);
  const cv::Mat b = Paint(style, 1);
  const cv::Mat c = Paint(style, 2);
  ASSERT_EQ(a.size(), cv::Size(400, 400));
  EXPECT_EQ(cv::norm(a, b, cv::NORM_INF), 0.0);
  EXPECT_GT(cv::norm(a, c, cv::NORM_L1) / static_cast<double>(a.total()), 3.0);
}

TEST_P(EveryStyle, DoesNotRepeatItself) {
  cv::Mat gray;
  cv::cvtColor(Paint(static_cast<TextureStyle>(GetParam()), 3), gray, cv::COLOR_BGR2GRAY);
  constexpr int kPatch = 40;
  for (const cv::Point at : {cv::Point(60, 90), cv::Point(210, 170), cv::Point(300, 320)}) {
    const cv::Rect patch(at.x, at.y, kPatch, kPatch);
    cv::Mat score;
    cv::matchTemplate(gray, gray(patch), score, cv::TM_CCOEFF_NORMED);
    // What is near the patch itself is of course like it.
    cv::circle(score, at, kPatch / 2, cv::Scalar(-1.0), cv::FILLED);
    double best = 0.0;
    cv::minMaxLoc(score, nullptr, &best);
    EXPECT_LT(best, 0.96);
  }
}

TEST(Texture, KeepsItsSizeWithinBounds) {
  EXPECT_EQ(Paint(TextureStyle::kWood, 1, 0.001, 0.003).size(), cv::Size(8, 8));
  EXPECT_EQ(Paint(TextureStyle::kPlain, 1, 40.0, 0.003).size(), cv::Size(4096, 4096));
}

}  // namespace
}  // namespace s3lam
