#include "s3lam/slam/export.h"

namespace s3lam::slam {
namespace {

/// Between two poses, at `share` of the way, centre and rotation apart.
Rigid3 Interpolate(const Rigid3& a, const Rigid3& b, double share) {
  Rigid3 pose;
  pose.rotation = a.rotation.slerp(share, b.rotation);
  const Eigen::Vector3d center = (1.0 - share) * a.CenterInB() + share * b.CenterInB();
  pose.translation = -(pose.rotation * center);
  return pose;
}

}  // namespace

FrameLocalizer::FrameLocalizer(const Tracker& tracker, const Map& map,
                               const std::vector<FrameTrack>& tracks,
                               const std::vector<int>& keyframe_of_frame)
    : tracker_(tracker), map_(map), tracks_(tracks), keyframe_of_frame_(keyframe_of_frame) {}

FrameTrack FrameLocalizer::Localize(int frame) const {
  if (keyframe_of_frame_[frame] != kNoIndex) return FromKeyframe(keyframe_of_frame_[frame]);
  if (!tracks_[frame].tracked) return FromNeighbours(frame);
  return tracker_.TrackNear(map_, frame, tracks_[frame], CurrentPose(map_, tracks_[frame]));
}

FrameTrack FrameLocalizer::FromKeyframe(int keyframe) const {
  FrameTrack track;
  track.tracked = true;
  track.cam_from_world = map_.keyframe(keyframe).cam_from_world;
  track.reference_keyframe = keyframe;
  track.matches = map_.MatchesOf(keyframe);
  return track;
}

FrameTrack FrameLocalizer::FromNeighbours(int frame) const {
  const int end = static_cast<int>(tracks_.size());
  int before = frame - 1;
  int after = frame + 1;
  while (before >= 0 && !tracks_[before].tracked) --before;
  while (after < end && !tracks_[after].tracked) ++after;
  if (before < 0 && after >= end) return {};
  if (before < 0) before = after;
  if (after >= end) after = before;
  const double share =
      after > before ? static_cast<double>(frame - before) / (after - before) : 0.0;
  const Rigid3 guess =
      Interpolate(CurrentPose(map_, tracks_[before]), CurrentPose(map_, tracks_[after]), share);
  FrameTrack track =
      tracker_.TrackNear(map_, frame, share < 0.5 ? tracks_[before] : tracks_[after], guess);
  return track.tracked ? track : FrameTrack{};
}

}  // namespace s3lam::slam
