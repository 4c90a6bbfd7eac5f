#include "s3lam/report/drawing.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "s3lam/report/html_text.h"

namespace s3lam {
namespace {

constexpr double kTextSize = 12.0;       // px
constexpr double kHersheyHeight = 21.0;  // px of OpenCV's simplex font at scale 1.
constexpr int kSubpixelBits = 4;

cv::Scalar ToScalar(const Rgb& color) {
  return {double(color[2]), double(color[1]), double(color[0])};
}

std::string Hex(const Rgb& color) {
  return fmt::format("#{:02x}{:02x}{:02x}", color[0], color[1], color[2]);
}

const char* AnchorName(Drawing::Anchor anchor) {
  switch (anchor) {
    case Drawing::Anchor::kMiddle:
      return "middle";
    case Drawing::Anchor::kEnd:
      return "end";
    case Drawing::Anchor::kStart:
      break;
  }
  return "start";
}

std::string AsciiOnly(std::string text) {
  for (char& c : text) {
    if (c < ' ' || c > '~') c = '?';
  }
  return text;
}

}  // namespace

void Drawing::Rectangle(const Eigen::Vector2d& corner, const Eigen::Vector2d& size,
                        const Rgb& color) {
  items_.emplace_back(Box{corner, size, color});
}

void Drawing::Line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Rgb& color,
                   double width) {
  items_.emplace_back(Stroke{{a, b}, color, width});
}

void Drawing::Polyline(std::vector<Eigen::Vector2d> points, const Rgb& color, double width) {
  if (points.size() > 1) items_.emplace_back(Stroke{std::move(points), color, width});
}

void Drawing::Text(const Eigen::Vector2d& at, std::string text, Anchor anchor, const Rgb& color) {
  items_.emplace_back(Label{at, std::move(text), anchor, color});
}

std::string Drawing::ToSvg() const {
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" width=\"{}\" "
      "font-family=\"sans-serif\" font-size=\"{}\">\n",
      width_, height_, width_, kTextSize);
  for (const auto& item : items_) {
    if (const auto* box = std::get_if<Box>(&item)) {
      svg += fmt::format(
          "<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" fill=\"{}\"/>\n",
          box->corner.x(), box->corner.y(), box->size.x(), box->size.y(), Hex(box->color));
    } else if (const auto* stroke = std::get_if<Stroke>(&item)) {
      svg += "<polyline points=\"";
      for (const Eigen::Vector2d& p : stroke->points) {
        svg += fmt::format("{:.2f},{:.2f} ", p.x(), p.y());
      }
      svg += fmt::format("\" fill=\"none\" stroke=\"{}\" stroke-width=\"{:.2f}\"/>\n",
                         Hex(stroke->color), stroke->width);
    } else if (const auto* label = std::get_if<Label>(&item)) {
      svg +=
          fmt::format("<text x=\"{:.2f}\" y=\"{:.2f}\" text-anchor=\"{}\" fill=\"{}\">{}</text>\n",
                      label->at.x(), label->at.y(), AnchorName(label->anchor), Hex(label->color),
                      EscapeHtml(label->text));
    }
  }
  return svg + "</svg>\n";
}

cv::Mat Drawing::ToImage(double scale) const {
  const auto to_px = [scale](double value) { return static_cast<int>(std::lround(value * scale)); };
  const auto fixed = [scale](const Eigen::Vector2d& p) {
    // Far outside the picture OpenCV's fixed-point coordinates would overflow.
    const Eigen::Vector2d q = (p * scale).cwiseMax(-1e4).cwiseMin(1e5) * (1 << kSubpixelBits);
    return cv::Point(static_cast<int>(std::lround(q.x())), static_cast<int>(std::lround(q.y())));
  };
  cv::Mat image(to_px(height_), to_px(width_), CV_8UC3, cv::Scalar::all(255));
  for (const auto& item : items_) {
    if (const auto* box = std::get_if<Box>(&item)) {
      const Eigen::Vector2d end = box->corner + box->size;
      const cv::Rect rect(cv::Point(to_px(box->corner.x()), to_px(box->corner.y())),
                          cv::Point(to_px(end.x()), to_px(end.y())));
      if (rect.area() > 0) cv::rectangle(image, rect, ToScalar(box->color), cv::FILLED);
    } else if (const auto* stroke = std::get_if<Stroke>(&item)) {
      std::vector<cv::Point> points;
      for (const Eigen::Vector2d& p : stroke->points) points.push_back(fixed(p));
      cv::polylines(image, points, false, ToScalar(stroke->color),
                    std::max(1, to_px(stroke->width)), cv::LINE_AA, kSubpixelBits);
    } else if (const auto* label = std::get_if<Label>(&item)) {
      const std::string text = AsciiOnly(label->text);
      const double font_scale = 0.8 * kTextSize * scale / kHersheyHeight;
      int base_line = 0;
      const cv::Size size =
          cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, font_scale, 1, &base_line);
      int x = to_px(label->at.x());
      if (label->anchor == Anchor::kMiddle) x -= size.width / 2;
      if (label->anchor == Anchor::kEnd) x -= size.width;
      cv::putText(image, text, {x, to_px(label->at.y())}, cv::FONT_HERSHEY_SIMPLEX, font_scale,
                  ToScalar(label->color), 1, cv::LINE_AA);
    }
  }
  return image;
}

Rgb ErrorColor(double fraction) {
  static constexpr std::array<std::array<double, 3>, 5> kStops = {
      {{43, 92, 190}, {60, 170, 170}, {225, 205, 60}, {235, 130, 40}, {200, 30, 40}}};
  const double at = std::clamp(fraction, 0.0, 1.0) * (kStops.size() - 1);
  const size_t i = std::min(static_cast<size_t>(at), kStops.size() - 2);
  const double part = at - static_cast<double>(i);
  Rgb color;
  for (size_t c = 0; c < 3; ++c) {
    color[c] =
        static_cast<uint8_t>(std::lround((1.0 - part) * kStops[i][c] + part * kStops[i + 1][c]));
  }
  return color;
}

Rgb SeriesColor(size_t index) {
  static constexpr std::array<Rgb, 6> kColors = {{{120, 120, 120},
                                                  {217, 119, 6},
                                                  {37, 99, 235},
                                                  {5, 150, 105},
                                                  {190, 24, 93},
                                                  {124, 58, 237}}};
  return kColors[index % kColors.size()];
}

}  // namespace s3lam
