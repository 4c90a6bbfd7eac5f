#include "s3lam/report/trust_strip.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "s3lam/report/plots.h"

namespace s3lam::report {
namespace {

using Eigen::Vector2d;

constexpr Rgb kGrid = {228, 228, 228};
constexpr Rgb kCurve = {60, 60, 60};
constexpr Rgb kDark = {20, 20, 20};
constexpr Rgb kWhite = {255, 255, 255};
constexpr std::array kStates = {FrameState::kGood, FrameState::kWeak, FrameState::kLost};

constexpr int kWidth = 1240;  // px
constexpr int kHeight = 158;
constexpr double kLeft = 34.0;
constexpr double kRight = 20.0;
constexpr double kCurveTop = 34.0;
constexpr double kCurveBottom = 86.0;
constexpr double kBandTop = 94.0;
constexpr double kBandBottom = 116.0;
constexpr double kLegendLeft = 230.0;  // To the left, where it is seen in a narrow window too.
constexpr double kLegendPitch = 160.0;
constexpr double kLeastLabel = 52.0;  // A stretch as wide as this has room for "map 12".
constexpr int kMaxColumns = static_cast<int>(kWidth - kLeft - kRight);

/// Where frames lie in the picture.
class Columns {
 public:
  explicit Columns(int num_frames)
      : num_frames_(num_frames), count_(std::min(num_frames, kMaxColumns)) {}

  [[nodiscard]] size_t size() const { return static_cast<size_t>(count_); }
  [[nodiscard]] size_t Of(int frame) const {
    return static_cast<size_t>(static_cast<int64_t>(frame) * count_ / num_frames_);
  }
  /// Left edge of a column.
  [[nodiscard]] double X(size_t column) const {
    return kLeft + static_cast<double>(column) * (kWidth - kLeft - kRight) / count_;
  }
  /// Left edge of a frame.
  [[nodiscard]] double XOfFrame(int frame) const {
    return kLeft + static_cast<double>(frame) * (kWidth - kLeft - kRight) / num_frames_;
  }

 private:
  int num_frames_;
  int count_;
};

void DrawLegend(const FrameTrust& trust, Drawing& drawing) {
  drawing.Text({kLeft, 16}, "Trust in the frames", Drawing::Anchor::kStart, kDark);
  double x = kLegendLeft;
  for (const FrameState state : kStates) {
    int count = 0;
    for (const FrameStretch& stretch : trust.stretches) {
      if (stretch.state == state) count += stretch.Length();
    }
    drawing.Rectangle({x, 6}, {12, 12}, StateColor(state));
    drawing.Text({x + 18, 16}, fmt::format("{} ({})", StateTitle(state), count));
    x += kLegendPitch;
  }
}

void DrawCurve(const FrameTrust& trust, const Columns& columns, Drawing& drawing) {
  const auto y_of = [](double value) { return kCurveBottom - value * (kCurveBottom - kCurveTop); };
  for (const double value : {0.0, 0.5, 1.0}) {
    drawing.Line({kLeft, y_of(value)}, {kWidth - kRight, y_of(value)}, kGrid);
    drawing.Text({kLeft - 6, y_of(value) + 4}, fmt::format("{}", value), Drawing::Anchor::kEnd);
  }
  std::vector<double> least(columns.size(), 1.0);
  for (size_t i = 0; i < trust.frames.size(); ++i) {
    double& value = least[columns.Of(static_cast<int>(i))];
    value = std::min(value, trust.frames[i].trust);
  }
  std::vector<Vector2d> steps;
  for (size_t begin = 0; begin < least.size();) {
    size_t end = begin + 1;
    while (end < least.size() && least[end] == least[begin]) ++end;
    steps.emplace_back(columns.X(begin), y_of(least[begin]));
    steps.emplace_back(columns.X(end), y_of(least[begin]));
    begin = end;
  }
  drawing.Polyline(std::move(steps), kCurve, 1.2);
}

void DrawBand(const FrameTrust& trust, const Columns& columns, Drawing& drawing) {
  std::vector<FrameState> worst(columns.size(), FrameState::kGood);
  for (const FrameStretch& stretch : trust.stretches) {
    for (size_t c = columns.Of(stretch.first); c <= columns.Of(stretch.last); ++c) {
      worst[c] = std::max(worst[c], stretch.state);
    }
  }
  for (size_t begin = 0; begin < worst.size();) {
    size_t end = begin + 1;
    while (end < worst.size() && worst[end] == worst[begin]) ++end;
    drawing.Rectangle({columns.X(begin), kBandTop},
                      {columns.X(end) - columns.X(begin), kBandBottom - kBandTop},
                      StateColor(worst[begin]));
    begin = end;
  }
}

/// Which map a stretch is in, unless it is in the one shown, or too short to be told.
void LabelMapsApart(const FrameTrust& trust, const Columns& columns, Drawing& drawing) {
  for (const FrameStretch& stretch : trust.stretches) {
    if (stretch.state == FrameState::kLost || stretch.map == 0) continue;
    const double left = columns.XOfFrame(stretch.first);
    const double right = columns.XOfFrame(stretch.last + 1);
    if (right - left < kLeastLabel) continue;
    for (const double x : {left, right}) {
      drawing.Line({x, kBandTop - 4}, {x, kBandBottom}, kDark);
    }
    const bool is_dark = stretch.state == FrameState::kWeak;
    drawing.Text({0.5 * (left + right), kBandBottom - 7}, fmt::format("map {}", stretch.map),
                 Drawing::Anchor::kMiddle, is_dark ? kWhite : kDark);
  }
}

void DrawNumbers(int num_frames, const Columns& columns, Drawing& drawing) {
  for (const double tick : AxisTicks(0.0, num_frames, 12)) {
    const int frame = static_cast<int>(tick);
    if (frame != tick || frame >= num_frames) continue;
    const double x = 0.5 * (columns.XOfFrame(frame) + columns.XOfFrame(frame + 1));
    drawing.Line({x, kBandBottom}, {x, kBandBottom + 5}, kCurve);
    drawing.Text({x, kBandBottom + 19}, fmt::format("{}", frame), Drawing::Anchor::kMiddle);
  }
  drawing.Text({0.5 * (kLeft + kWidth - kRight), kHeight - 6.0}, "frame, counted from 0",
               Drawing::Anchor::kMiddle);
}

}  // namespace

Rgb StateColor(FrameState state) {
  switch (state) {
    case FrameState::kGood:
      return {120, 196, 240};
    case FrameState::kWeak:
      return {213, 94, 0};
    case FrameState::kLost:
      break;
  }
  return {35, 35, 35};
}

const char* StateTitle(FrameState state) {
  switch (state) {
    case FrameState::kGood:
      return "good";
    case FrameState::kWeak:
      return "little trusted";
    case FrameState::kLost:
      break;
  }
  return "not localised";
}

Drawing DrawTrustStrip(const FrameTrust& trust) {
  Drawing drawing(kWidth, kHeight);
  const Columns columns(trust.NumFrames());
  DrawLegend(trust, drawing);
  if (!trust.frames.empty()) DrawCurve(trust, columns, drawing);
  DrawBand(trust, columns, drawing);
  LabelMapsApart(trust, columns, drawing);
  DrawNumbers(trust.NumFrames(), columns, drawing);
  return drawing;
}

}  // namespace s3lam::report
