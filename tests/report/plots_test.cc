#include "s3lam/report/plots.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace s3lam {
namespace {

using Eigen::Vector2d;
using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

size_t Count(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

/// Pixels of the picture that are exactly of a colour.
int PixelsOfColor(const cv::Mat& image, const Rgb& color) {
  int count = 0;
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const auto& p = image.at<cv::Vec3b>(y, x);
      if (p[2] == color[0] && p[1] == color[1] && p[0] == color[2]) ++count;
    }
  }
  return count;
}

TEST(AxisTicks, RoundValuesWithinTheInterval) {
  EXPECT_THAT(AxisTicks(0.0, 1.0, 5),
              ElementsAre(0.0, DoubleNear(0.2, 1e-12), DoubleNear(0.4, 1e-12),
                          DoubleNear(0.6, 1e-12), DoubleNear(0.8, 1e-12), DoubleNear(1.0, 1e-12)));
  EXPECT_THAT(AxisTicks(-120.0, 130.0, 4), ElementsAre(-100.0, 0.0, 100.0));
  EXPECT_THAT(AxisTicks(1.0, 1.0, 4), IsEmpty());
  EXPECT_THAT(AxisTicks(std::numeric_limits<double>::infinity(), 1.0, 4), IsEmpty());
}

TEST(Drawing, SvgAndPixelsShowTheSame) {
  Drawing drawing(100, 50);
  drawing.Rectangle({10, 20}, {30, 5}, {200, 10, 20});
  EXPECT_THAT(drawing.ToSvg(), HasSubstr("<rect x=\"10.00\" y=\"20.00\" width=\"30.00\" "
                                         "height=\"5.00\" fill=\"#c80a14\"/>"));
  const cv::Mat image = drawing.ToImage(2.0);
  EXPECT_EQ(image.size(), cv::Size(200, 100));
  EXPECT_EQ(PixelsOfColor(image, {200, 10, 20}), 60 * 10);
  EXPECT_EQ(image.at<cv::Vec3b>(40, 20), cv::Vec3b(20, 10, 200));
  EXPECT_EQ(image.at<cv::Vec3b>(39, 20), cv::Vec3b(255, 255, 255));
}

TEST(Drawing, TextIsEscaped) {
  Drawing drawing(100, 50);
  drawing.Text({5, 5}, "</svg>\xFF");
  EXPECT_THAT(drawing.ToSvg(), HasSubstr("&lt;/svg&gt;\xEF\xBF\xBD"));
  EXPECT_EQ(drawing.ToImage().size(), cv::Size(100, 50));
}

TEST(ErrorColor, EndsAndClamps) {
  EXPECT_EQ(ErrorColor(-1.0), ErrorColor(0.0));
  EXPECT_EQ(ErrorColor(2.0), ErrorColor(1.0));
  EXPECT_GT(ErrorColor(0.0)[2], ErrorColor(0.0)[0]);  // Blue.
  EXPECT_GT(ErrorColor(1.0)[0], ErrorColor(1.0)[2]);  // Red.
}

TEST(Plots, CurvesHaveALineAndANameEach) {
  const std::vector<Series> series = {{"one", {{0, 1}, {1, 2}, {2, 1}}}, {"two", {{0, 2}, {2, 3}}}};
  PlotStyle style;
  style.title = "T";
  const std::string svg = PlotCurves(style, series).ToSvg();
  EXPECT_THAT(svg, HasSubstr(">one<"));
  EXPECT_THAT(svg, HasSubstr(">two<"));
  EXPECT_EQ(Count(svg, "stroke-width=\"1.40\""), 2u);
}

// 10 values of bin 0, 5 of the last one; the curve's highest point is twice as high as its end.
TEST(Plots, HistogramCounts) {
  ValueSeries series{"s", {}};
  for (int i = 0; i < 10; ++i) series.values.push_back(0.01);
  for (int i = 0; i < 5; ++i) series.values.push_back(1.0);
  PlotStyle style;
  style.height = 88 + 105;  // 105 px of plot for 1.05 * 10 values: 10 px per value.
  const std::string svg = PlotHistogram(style, {series}, 4).ToSvg();
  const double base = style.height - 44;
  EXPECT_THAT(svg, HasSubstr(fmt::format("64.00,{:.2f} 64.00,{:.2f} ", base, base - 100.0)));
  EXPECT_THAT(svg, HasSubstr(fmt::format("604.00,{:.2f} 604.00,{:.2f} ", base - 50.0, base)));
}

TEST(Plots, NothingAndConstantsAreDrawnWithoutNan) {
  const PlotStyle style;
  for (const Drawing& drawing :
       {PlotCurves(style, {}), PlotCurves(style, {{"c", {{1, 0}, {1, 0}}}}),
        PlotHistogram(style, {{"h", {}}}, 10), PlotHistogram(style, {{"h", {0.0, 0.0}}}, 10),
        PlotErrorPath(style, {}, {}, 0.0),
        PlotErrorPath(style, {{{3, 3}, {3, 3}}, {0.0, 0.0}}, {{3, 3}}, 0.0)}) {
    EXPECT_THAT(drawing.ToSvg(), Not(HasSubstr("nan")));
    EXPECT_THAT(drawing.ToSvg(), Not(HasSubstr("inf")));
    EXPECT_FALSE(drawing.ToImage().empty());
  }
}

TEST(Plots, ErrorPathIsColouredByErrorInOneScale) {
  const ErrorPath path{{{0, 0}, {10, 0}, {10, 1}}, {0.0, 2.0, 1.0}};
  const std::string svg = PlotErrorPath(PlotStyle(), path, {}, 2.0).ToSvg();
  const auto hex = [](const Rgb& c) {
    return fmt::format("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]);
  };
  EXPECT_THAT(svg, HasSubstr("stroke=\"" + hex(ErrorColor(1.0)) + "\" stroke-width=\"2.20\""));
  EXPECT_THAT(svg, HasSubstr("stroke=\"" + hex(ErrorColor(0.5)) + "\" stroke-width=\"2.20\""));
}

TEST(Plots, ManyPosesAreThinned) {
  ErrorPath path;
  for (int i = 0; i < 100000; ++i) path.positions.emplace_back(i, i % 7);
  path.errors.assign(path.positions.size(), 1.0);
  EXPECT_LT(PlotErrorPath(PlotStyle(), path, path.positions, 1.0).ToSvg().size(), 500000u);
}

}  // namespace
}  // namespace s3lam
