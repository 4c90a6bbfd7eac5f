#include "s3lam/slam/stops.h"

#include <algorithm>
#include <numbers>
#include <vector>

#include "s3lam/base/statistics.h"

namespace s3lam::slam {
namespace {

constexpr double kStillPx = 1.0;
constexpr int kMinFrames = 10;

/// How far the centre's way from one view to the other moves a point of median depth [px].
double ParallaxPx(const FrameView& from, const FrameView& to, double focal_length) {
  const Eigen::Vector3d way = to.cam_from_world.CenterInB() - from.cam_from_world.CenterInB();
  return focal_length * way.norm() / from.median_depth;
}

/// How many of the turns [px] come before the first of more than a pixel.
int CountStill(const std::vector<double>& turns_px) {
  const auto turned =
      std::find_if(turns_px.begin(), turns_px.end(), [](double turn) { return turn > kStillPx; });
  return static_cast<int>(turned - turns_px.begin());
}

/// The stop that begins with frame `first`, as long as it lasts. Where most of it stands still it
/// ends with the first turn: a start moves the centre by little at first.
StopReport StopFrom(std::span<const std::optional<FrameView>> views, int first,
                    double focal_length) {
  const FrameView& start = *views[first];
  StopReport stop;
  stop.map = start.map;
  stop.first_frame = first;
  std::vector<double> turns_px{0.0};
  for (int i = first + 1; i < static_cast<int>(views.size()); ++i) {
    const bool stays = views[i] && views[i]->map == start.map &&
                       ParallaxPx(start, *views[i], focal_length) < kStillPx;
    if (!stays) break;
    turns_px.push_back(focal_length * RotationAngle(start.cam_from_world.rotation,
                                                    views[i]->cam_from_world.rotation));
  }
  if (Median(turns_px) > kStillPx) {
    stop.kind = StopReport::Kind::kRotation;
  } else {
    turns_px.resize(static_cast<size_t>(CountStill(turns_px)));
  }
  stop.last_frame = first + static_cast<int>(turns_px.size()) - 1;
  stop.turn_deg =
      *std::max_element(turns_px.begin(), turns_px.end()) / focal_length * 180.0 / std::numbers::pi;
  return stop;
}

}  // namespace

std::vector<StopReport> FindStops(std::span<const std::optional<FrameView>> views,
                                  double focal_length) {
  std::vector<StopReport> stops;
  for (int i = 0; i < static_cast<int>(views.size()); ++i) {
    if (!views[i] || !(views[i]->median_depth > 0.0)) continue;
    const StopReport stop = StopFrom(views, i, focal_length);
    if (stop.last_frame - stop.first_frame + 1 < kMinFrames) continue;
    stops.push_back(stop);
    i = stop.last_frame;
  }
  return stops;
}

}  // namespace s3lam::slam
