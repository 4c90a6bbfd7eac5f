#include "s3lam/slam/stops.h"

#include <algorithm>
#include <numbers>

namespace s3lam::slam {
namespace {

constexpr double kStillPx = 1.0;
constexpr int kMinFrames = 10;

/// How far the centre's way from one view to the other moves a point of median depth [px].
double ParallaxPx(const FrameView& from, const FrameView& to, double focal_length) {
  const Eigen::Vector3d way = to.cam_from_world.CenterInB() - from.cam_from_world.CenterInB();
  return focal_length * way.norm() / from.median_depth;
}

/// The stop that begins with frame `first`, as long as it lasts.
StopReport StopFrom(std::span<const std::optional<FrameView>> views, int first,
                    double focal_length) {
  const FrameView& start = *views[first];
  StopReport stop;
  stop.map = start.map;
  stop.first_frame = stop.last_frame = first;
  double turn_rad = 0.0;
  for (int i = first + 1; i < static_cast<int>(views.size()); ++i) {
    const bool stays = views[i] && views[i]->map == start.map &&
                       ParallaxPx(start, *views[i], focal_length) < kStillPx;
    if (!stays) break;
    stop.last_frame = i;
    turn_rad = std::max(
        turn_rad, RotationAngle(start.cam_from_world.rotation, views[i]->cam_from_world.rotation));
  }
  if (focal_length * turn_rad > kStillPx) stop.kind = StopReport::Kind::kRotation;
  stop.turn_deg = turn_rad * 180.0 / std::numbers::pi;
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
