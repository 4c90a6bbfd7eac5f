#include "s3lam/report/plots.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace s3lam {
namespace {

using Eigen::Vector2d;

constexpr Rgb kGrid = {228, 228, 228};
constexpr Rgb kTruth = {150, 150, 150};
constexpr double kLeft = 64.0;  // Margins [px].
constexpr double kRight = 16.0;
constexpr double kTop = 44.0;
constexpr double kBottom = 44.0;
constexpr size_t kMaxCurvePoints = 2000;

/// The data's rectangle and where it lies in the picture.
class Frame {
 public:
  Frame(const PlotStyle& style, const Vector2d& min, const Vector2d& max, double right = kRight)
      : drawing_(style.width, style.height),
        min_(min),
        max_(max),
        origin_(kLeft, style.height - kBottom),
        size_(style.width - kLeft - right, style.height - kTop - kBottom) {
    for (int i = 0; i < 2; ++i) {
      if (max_[i] > min_[i]) continue;
      const double around = std::max(1e-9, 0.5 * std::abs(min_[i]));
      max_[i] = min_[i] + around;
    }
  }

  /// The same scale on both axes: enlarges the shorter interval about its middle.
  void EqualScale() {
    const Vector2d range = max_ - min_;
    const double per_px = std::max(range.x() / size_.x(), range.y() / size_.y());
    const Vector2d middle = 0.5 * (min_ + max_);
    min_ = middle - 0.5 * per_px * size_;
    max_ = middle + 0.5 * per_px * size_;
  }

  [[nodiscard]] Vector2d ToPixel(const Vector2d& p) const {
    const Vector2d part = (p - min_).cwiseQuotient(max_ - min_).cwiseProduct(size_);
    return origin_ + Vector2d(part.x(), -part.y());
  }

  void DrawAxes(const PlotStyle& style) {
    for (const double x : AxisTicks(min_.x(), max_.x(), 8)) {
      const Vector2d at = ToPixel({x, min_.y()});
      drawing_.Line(at, {at.x(), origin_.y() - size_.y()}, kGrid);
      drawing_.Text(at + Vector2d(0, 15), fmt::format("{:.6g}", x), Drawing::Anchor::kMiddle);
    }
    for (const double y : AxisTicks(min_.y(), max_.y(), 6)) {
      const Vector2d at = ToPixel({min_.x(), y});
      drawing_.Line(at, {origin_.x() + size_.x(), at.y()}, kGrid);
      drawing_.Text(at + Vector2d(-6, 4), fmt::format("{:.6g}", y), Drawing::Anchor::kEnd);
    }
    drawing_.Text({0.5 * style.width, 16}, style.title, Drawing::Anchor::kMiddle, {20, 20, 20});
    drawing_.Text({origin_.x() + 0.5 * size_.x(), style.height - 10.0}, style.x_label,
                  Drawing::Anchor::kMiddle);
    drawing_.Text({6, 34}, style.y_label);
  }

  void DrawLegend(const std::vector<std::string>& names) {
    double y = kTop + 16;
    for (size_t i = 0; i < names.size(); ++i, y += 16) {
      const double x = origin_.x() + size_.x() - 8;
      drawing_.Rectangle({x - 12, y - 9}, {12, 10}, SeriesColor(i));
      drawing_.Text({x - 18, y}, names[i], Drawing::Anchor::kEnd);
    }
  }

  [[nodiscard]] Drawing& drawing() { return drawing_; }
  [[nodiscard]] const Vector2d& origin() const { return origin_; }
  [[nodiscard]] const Vector2d& size() const { return size_; }

 private:
  Drawing drawing_;
  Vector2d min_, max_, origin_, size_;
};

struct Bounds {
  Vector2d min = Vector2d::Constant(std::numeric_limits<double>::infinity());
  Vector2d max = -min;

  void Add(const Vector2d& p) {
    min = min.cwiseMin(p);
    max = max.cwiseMax(p);
  }
  void Add(const std::vector<Vector2d>& points) {
    for (const Vector2d& p : points) Add(p);
  }
  /// Finite, whatever was added.
  void Settle() {
    if (!(min.allFinite() && max.allFinite())) {
      min.setZero();
      max.setOnes();
    }
  }
};

/// Every n-th index, so that no more than kMaxCurvePoints (and the last) remain.
std::vector<size_t> Thinned(size_t size) {
  const size_t step = std::max<size_t>(1, (size + kMaxCurvePoints - 1) / kMaxCurvePoints);
  std::vector<size_t> kept;
  for (size_t i = 0; i < size; i += step) kept.push_back(i);
  if (size > 0 && kept.back() != size - 1) kept.push_back(size - 1);
  return kept;
}

std::vector<Vector2d> ThinnedPixels(const Frame& frame, const std::vector<Vector2d>& points) {
  std::vector<Vector2d> pixels;
  for (const size_t i : Thinned(points.size())) pixels.push_back(frame.ToPixel(points[i]));
  return pixels;
}

double Percentile99(const std::vector<ValueSeries>& series) {
  std::vector<double> all;
  for (const ValueSeries& s : series) all.insert(all.end(), s.values.begin(), s.values.end());
  if (all.empty()) return 1.0;
  const auto at = all.begin() + static_cast<std::ptrdiff_t>(0.99 * double(all.size() - 1));
  std::nth_element(all.begin(), at, all.end());
  return *at > 0.0 ? *at : 1.0;
}

}  // namespace

std::vector<double> AxisTicks(double min, double max, int count) {
  if (!(max > min) || count < 1) return {};
  const double rough = (max - min) / count;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  double step = 10.0 * power;
  for (const double factor : {5.0, 2.0, 1.0}) {
    if (factor * power >= rough * (1.0 - 1e-9)) step = factor * power;
  }
  std::vector<double> ticks;
  const double first = std::ceil(min / step - 1e-9);
  for (double k = first; k * step <= max + 1e-9 * step; k += 1.0) {
    ticks.push_back(k == 0.0 ? 0.0 : k * step);
  }
  return ticks;
}

Drawing PlotCurves(const PlotStyle& style, const std::vector<Series>& series) {
  Bounds bounds;
  for (const Series& s : series) bounds.Add(s.points);
  bounds.Settle();
  Frame frame(style, {bounds.min.x(), std::min(0.0, bounds.min.y())},
              {bounds.max.x(), 1.05 * bounds.max.y()});
  frame.DrawAxes(style);
  std::vector<std::string> names;
  for (size_t i = 0; i < series.size(); ++i) {
    names.push_back(series[i].name);
    frame.drawing().Polyline(ThinnedPixels(frame, series[i].points), SeriesColor(i), 1.4);
  }
  frame.DrawLegend(names);
  return frame.drawing();
}

Drawing PlotHistogram(const PlotStyle& style, const std::vector<ValueSeries>& series,
                      int num_bins) {
  const double max_value = Percentile99(series);
  const double bin = max_value / num_bins;
  std::vector<std::string> names;
  std::vector<std::vector<Vector2d>> outlines;
  double highest = 1.0;
  for (const ValueSeries& s : series) {
    names.push_back(s.name);
    std::vector<double> counts(static_cast<size_t>(num_bins), 0.0);
    for (const double value : s.values) {
      counts[std::min(static_cast<size_t>(std::min(value, max_value) / bin), counts.size() - 1)] +=
          1.0;
    }
    std::vector<Vector2d> outline = {{0.0, 0.0}};
    for (size_t k = 0; k < counts.size(); ++k) {
      outline.emplace_back(static_cast<double>(k) * bin, counts[k]);
      outline.emplace_back(static_cast<double>(k + 1) * bin, counts[k]);
      highest = std::max(highest, counts[k]);
    }
    outline.emplace_back(max_value, 0.0);
    outlines.push_back(std::move(outline));
  }
  Frame frame(style, Vector2d::Zero(), {max_value, 1.05 * highest});
  frame.DrawAxes(style);
  for (size_t i = 0; i < outlines.size(); ++i) {
    for (Vector2d& p : outlines[i]) p = frame.ToPixel(p);
    frame.drawing().Polyline(std::move(outlines[i]), SeriesColor(i), 1.6);
  }
  frame.DrawLegend(names);
  return frame.drawing();
}

Drawing PlotErrorPath(const PlotStyle& style, const ErrorPath& path,
                      const std::vector<Vector2d>& truth, double max_error) {
  Bounds bounds;
  bounds.Add(path.positions);
  bounds.Add(truth);
  bounds.Settle();
  constexpr double kScaleWidth = 74.0;
  const Vector2d margin = 0.03 * (bounds.max - bounds.min);
  Frame frame(style, bounds.min - margin, bounds.max + margin, kRight + kScaleWidth);
  frame.EqualScale();
  frame.DrawAxes(style);
  Drawing& drawing = frame.drawing();
  drawing.Polyline(ThinnedPixels(frame, truth), kTruth, 1.0);
  const double top = max_error > 0.0 ? max_error : 1.0;
  const std::vector<size_t> kept = Thinned(path.positions.size());
  for (size_t k = 1; k < kept.size(); ++k) {
    drawing.Line(frame.ToPixel(path.positions[kept[k - 1]]), frame.ToPixel(path.positions[kept[k]]),
                 ErrorColor(path.errors[kept[k]] / top), 2.2);
  }
  constexpr int kSteps = 40;
  const double x = frame.origin().x() + frame.size().x() + 14;
  const double step = frame.size().y() / kSteps;
  for (int i = 0; i < kSteps; ++i) {
    drawing.Rectangle({x, frame.origin().y() - (i + 1) * step}, {12, step + 0.5},
                      ErrorColor((i + 0.5) / kSteps));
  }
  for (const double tick : AxisTicks(0.0, top, 5)) {
    const double y = frame.origin().y() - tick / top * frame.size().y();
    drawing.Text({x + 16, y + 4}, fmt::format("{:.3g}", tick));
  }
  return drawing;
}

}  // namespace s3lam
