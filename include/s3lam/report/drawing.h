#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <string>
#include <variant>
#include <vector>

#include "s3lam/scene/reconstruction.h"

namespace s3lam {

/// A picture as a list of strokes, so that the page (SVG) and the picture files (pixels) show the
/// same. Coordinates are px, x to the right, y down.
class Drawing {
 public:
  enum class Anchor { kStart, kMiddle, kEnd };

  Drawing(int width, int height) : width_(width), height_(height) {}

  void Rectangle(const Eigen::Vector2d& corner, const Eigen::Vector2d& size, const Rgb& color);
  void Line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Rgb& color,
            double width = 1.0);
  void Polyline(std::vector<Eigen::Vector2d> points, const Rgb& color, double width = 1.0);
  /// `at` is on the base line.
  void Text(const Eigen::Vector2d& at, std::string text, Anchor anchor = Anchor::kStart,
            const Rgb& color = {60, 60, 60});

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }

  /// An <svg> element.
  [[nodiscard]] std::string ToSvg() const;
  /// 8-bit BGR, white where nothing is drawn. Characters outside ASCII become '?'.
  [[nodiscard]] cv::Mat ToImage(double scale = 1.0) const;

 private:
  struct Box {
    Eigen::Vector2d corner, size;
    Rgb color;
  };
  struct Stroke {
    std::vector<Eigen::Vector2d> points;
    Rgb color;
    double width;
  };
  struct Label {
    Eigen::Vector2d at;
    std::string text;
    Anchor anchor;
    Rgb color;
  };

  int width_;
  int height_;
  std::vector<std::variant<Box, Stroke, Label>> items_;
};

/// From blue (0) over yellow to red (1); values outside are clamped.
Rgb ErrorColor(double fraction);

/// The colour of curve or arm number `index`.
Rgb SeriesColor(size_t index);

}  // namespace s3lam
