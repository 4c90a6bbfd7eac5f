#include "s3lam/slam/map_builder.h"

#include <algorithm>
#include <cstdlib>

#include "s3lam/base/log.h"

namespace s3lam {
namespace {

constexpr int kRecentKeyframesToTry = 5;
constexpr int kMaxKeyframesToTry = 30;
constexpr int kRecoverStep = 2;  // Frames between attempts to recognise the place.

/// The motion from one frame to the next that takes `gap` equal steps to make `motion`.
Rigid3 Fraction(const Rigid3& motion, int gap) {
  const double share = 1.0 / gap;
  return {Eigen::Quaterniond::Identity().slerp(share, motion.rotation), share * motion.translation};
}

}  // namespace

MapBuilder::MapBuilder(const TrackerOptions& tracker_options, const MapperOptions& mapper_options,
                       const FeatureOptions& feature_options, std::vector<FrameFeatures>& frames,
                       const Undistorter& undistorter, ProgressCallback progress)
    : frames_(frames),
      map_(frames, feature_options),
      tracker_(tracker_options, undistorter),
      mapper_(mapper_options, undistorter),
      progress_(std::move(progress)),
      tracks_(frames.size()) {}

void MapBuilder::Start(const InitialPair& pair) {
  initial_ = pair;
  const int a = map_.AddKeyframe(pair.frame_a, Rigid3{});
  const int b = map_.AddKeyframe(pair.frame_b, pair.b_from_a);
  FrameTrack track_a;
  FrameTrack track_b;
  for (const InitialPoint& initial : pair.points) {
    const int point = map_.AddPoint(initial.position, a);
    map_.AddObservation(point, {a, initial.keypoint_a});
    map_.AddObservation(point, {b, initial.keypoint_b});
    map_.UpdateAppearance(point);
    map_.UpdateGeometry(point);
    track_a.matches.push_back({initial.keypoint_a, point});
    track_b.matches.push_back({initial.keypoint_b, point});
  }
  for (const int keyframe : {a, b}) {
    FrameTrack& track = keyframe == a ? track_a : track_b;
    track.tracked = true;
    track.reference_keyframe = keyframe;
    track.cam_from_world = map_.keyframe(keyframe).cam_from_world;
    tracks_[map_.keyframe(keyframe).frame] = std::move(track);
  }
  mapper_.TriangulateNewPoints(map_, b, 1);
  mapper_.AdjustGlobally(map_, 2, 1);
  frames_done_ = 2;
  last_keyframe_frame_ = pair.frame_b;
}

bool MapBuilder::IsTracked(int frame) const {
  return frame >= 0 && frame < static_cast<int>(tracks_.size()) && tracks_[frame].tracked;
}

Rigid3 MapBuilder::PredictPose(int frame, int direction) const {
  const int last = frame - direction;
  const Rigid3 pose = CurrentPose(map_, tracks_[last]);
  const int before = last - direction;
  if (IsTracked(before)) {
    const Rigid3 velocity = pose * CurrentPose(map_, tracks_[before]).Inverse();
    return velocity * pose;
  }
  if (last == initial_.frame_a || last == initial_.frame_b) {
    const Rigid3 b_from_a = map_.PoseOf(1) * map_.PoseOf(0).Inverse();
    const Rigid3 step = Fraction(b_from_a, initial_.frame_b - initial_.frame_a);
    return (direction > 0 ? step : step.Inverse()) * pose;
  }
  return pose;
}

bool MapBuilder::TrackFrame(int frame, int direction) {
  const FrameTrack& last = tracks_[frame - direction];
  FrameTrack track = tracker_.Track(map_, frame, last, PredictPose(frame, direction));
  if (!track.tracked) return false;
  for (const PointMatch& match : track.matches) map_.CountVisible(match.point, true);
  for (const int point : track.missed) map_.CountVisible(point, false);
  track.missed.clear();
  track.missed.shrink_to_fit();
  const bool needs_keyframe =
      tracker_.NeedsKeyframe(map_, track, std::abs(frame - last_keyframe_frame_));
  tracks_[frame] = std::move(track);
  if (needs_keyframe) MakeKeyframe(frame);
  progress_(++frames_done_, map_.num_keyframes());
  return true;
}

void MapBuilder::MakeKeyframe(int frame) {
  FrameTrack& track = tracks_[frame];
  const int keyframe = mapper_.AddKeyframe(map_, frame, track);
  track.reference_keyframe = keyframe;
  track.cam_from_reference = Rigid3{};
  track.matches = map_.MatchesOf(keyframe);
  last_keyframe_frame_ = frame;
}

int MapBuilder::Follow(int first, int direction) {
  int frame = first;
  while (frame >= 0 && frame < static_cast<int>(frames_.size()) && !IsTracked(frame)) {
    if (!TrackFrame(frame, direction)) {
      spdlog::info("tracking lost at frame {}", frame);
      break;
    }
    frame += direction;
  }
  // What lies beyond the last keyframe is known from one side only: the last frame becomes one too.
  const int last = frame - direction;
  if (last != last_keyframe_frame_ && IsTracked(last)) MakeKeyframe(last);
  return frame;
}

int MapBuilder::Recover(int lost) {
  std::vector<int> alive;
  for (int k = map_.num_keyframes() - 1; k >= 0; --k) {
    if (map_.keyframe(k).alive) alive.push_back(k);
  }
  // The latest keyframes and an even choice of the others.
  std::vector<int> keyframes;
  const size_t recent = std::min<size_t>(alive.size(), kRecentKeyframesToTry);
  keyframes.assign(alive.begin(), alive.begin() + static_cast<std::ptrdiff_t>(recent));
  const size_t rest = alive.size() - recent;
  const size_t stride = rest / (kMaxKeyframesToTry - kRecentKeyframesToTry) + 1;
  for (size_t i = recent; i < alive.size(); i += stride) keyframes.push_back(alive[i]);
  for (int frame = lost; frame < static_cast<int>(frames_.size()); frame += kRecoverStep) {
    if (IsTracked(frame)) continue;
    for (const int keyframe : keyframes) {
      FrameTrack track = tracker_.Relocalize(map_, frame, keyframe);
      if (!track.tracked) continue;
      track.missed.clear();
      tracks_[frame] = std::move(track);
      ++num_relocalizations_;
      spdlog::info("frame {} recognised", frame);
      return frame;
    }
  }
  return static_cast<int>(frames_.size());
}

void MapBuilder::Grow() {
  const int end = static_cast<int>(frames_.size());
  int frame = Follow(initial_.frame_b + 1, +1);
  last_keyframe_frame_ = initial_.frame_a;
  Follow(initial_.frame_a - 1, -1);
  while (frame < end) {
    const int found = Recover(frame);
    if (found == end) break;
    last_keyframe_frame_ = found;
    Follow(found - 1, -1);
    last_keyframe_frame_ = found;
    frame = Follow(found + 1, +1);
  }
}

}  // namespace s3lam
