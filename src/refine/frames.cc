#include "s3lam/refine/frames.h"

#include <algorithm>
#include <vector>

namespace s3lam {
namespace {

/// A baseline shorter than this part of the distance from the world's origin may be rounding.
constexpr double kMinBaselineRatio = 1e-6;
/// A local change of scale beyond this is noise of a short baseline, not drift.
constexpr double kMaxScaleChange = 2.0;

double LocalScale(const MovedKeyframe& a, const MovedKeyframe& b) {
  const Eigen::Vector3d old_a = a.old_cam_from_world.CenterInB();
  const double before = (b.old_cam_from_world.CenterInB() - old_a).norm();
  const double after = (b.new_cam_from_world.CenterInB() - a.new_cam_from_world.CenterInB()).norm();
  if (!(before > kMinBaselineRatio * old_a.norm()) || !(before > 0.0)) return 1.0;
  const double scale = after / before;
  return scale > kMaxScaleChange || scale < 1.0 / kMaxScaleChange ? 1.0 : scale;
}

/// The pose at the same place relative to the keyframe, offsets times `scale`.
Rigid3 Attach(const Rigid3& world_from_camera, const MovedKeyframe& keyframe, double scale) {
  Rigid3 keyframe_from_camera = keyframe.old_cam_from_world * world_from_camera;
  keyframe_from_camera.translation *= scale;
  return keyframe.new_cam_from_world.Inverse() * keyframe_from_camera;
}

Rigid3 Blend(const Rigid3& a, const Rigid3& b, double weight_b) {
  return {a.rotation.slerp(weight_b, b.rotation).normalized(),
          (1.0 - weight_b) * a.translation + weight_b * b.translation};
}

}  // namespace

Trajectory CarryFrames(const Trajectory& frames, std::span<const MovedKeyframe> keyframes) {
  std::vector<MovedKeyframe> sorted(keyframes.begin(), keyframes.end());
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const auto& a, const auto& b) { return a.time_s < b.time_s; });
  Trajectory carried = frames;
  if (sorted.empty()) return carried;
  for (TimedPose& frame : carried) {
    const auto after =
        std::lower_bound(sorted.begin(), sorted.end(), frame.time_s,
                         [](const MovedKeyframe& k, double time) { return k.time_s < time; });
    Rigid3& pose = frame.world_from_camera;
    if (after == sorted.end()) {
      pose = Attach(pose, sorted.back(), 1.0);
    } else if (after == sorted.begin() || after->time_s == frame.time_s) {
      pose = Attach(pose, *after, 1.0);
    } else {
      const auto before = after - 1;
      const double scale = LocalScale(*before, *after);
      const double weight = (frame.time_s - before->time_s) / (after->time_s - before->time_s);
      pose = Blend(Attach(pose, *before, scale), Attach(pose, *after, scale), weight);
    }
  }
  return carried;
}

}  // namespace s3lam
