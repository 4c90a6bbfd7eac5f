#include "s3lam/slam/map_builder.h"

#include <algorithm>
#include <cstdlib>

#include "s3lam/base/log.h"

namespace s3lam {
namespace {

constexpr int kNearKeyframesToTry = 5;
constexpr int kSimilarKeyframesToTry = 8;
constexpr int kRecoverStep = 2;  // Frames between attempts to recognise the place.

/// The motion from one frame to the next that takes `gap` equal steps to make `motion`.
Rigid3 Fraction(const Rigid3& motion, int gap) {
  const double share = 1.0 / gap;
  return {Eigen::Quaterniond::Identity().slerp(share, motion.rotation), share * motion.translation};
}

}  // namespace

MapBuilder::MapBuilder(const TrackerOptions& tracker_options, const MapperOptions& mapper_options,
                       const FeatureOptions& feature_options, std::vector<FrameFeatures>& frames,
                       const Undistorter& undistorter, const Vocabulary& vocabulary,
                       std::vector<uint8_t> frame_is_taken)
    : frames_(frames),
      map_(frames, feature_options),
      tracker_(tracker_options, undistorter),
      mapper_(mapper_options, undistorter),
      vocabulary_(vocabulary),
      places_(vocabulary),
      frame_is_taken_(std::move(frame_is_taken)),
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
  BeginLeg(pair.frame_a, +1);  // Last, between the two: the motion need not be even there.
  BeginLeg(pair.frame_a, -1);
  BeginLeg(pair.frame_b, +1);
}

bool MapBuilder::IsTracked(int frame) const {
  return frame >= 0 && frame < static_cast<int>(tracks_.size()) && tracks_[frame].tracked;
}

bool MapBuilder::IsFree(int frame) const {
  return frame >= 0 && frame < static_cast<int>(tracks_.size()) && !tracks_[frame].tracked &&
         frame_is_taken_[frame] == 0;
}

int MapBuilder::NumTracked() const {
  return static_cast<int>(std::count_if(tracks_.begin(), tracks_.end(),
                                        [](const FrameTrack& track) { return track.tracked; }));
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
      tracker_.NeedsKeyframe(map_, frame, track, std::abs(frame - last_keyframe_frame_));
  tracks_[frame] = std::move(track);
  if (needs_keyframe) MakeKeyframe(frame);
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

void MapBuilder::BeginLeg(int origin, int direction) {
  legs_.push_back({origin, origin + direction, direction});
  last_keyframe_frame_ = origin;
}

void MapBuilder::EndLeg() {
  // What lies beyond the last keyframe is known from one side only: the last frame becomes one too.
  const int last = legs_.back().frame - legs_.back().direction;
  if (last != last_keyframe_frame_ && IsTracked(last)) MakeKeyframe(last);
  legs_.pop_back();
  if (!legs_.empty()) last_keyframe_frame_ = legs_.back().origin;
}

std::vector<int> MapBuilder::Lookalikes(int frame) {
  std::vector<uint8_t> is_erased(static_cast<size_t>(map_.num_keyframes()), 0);
  for (int k = 0; k < map_.num_keyframes(); ++k) is_erased[k] = map_.keyframe(k).alive ? 0 : 1;
  for (; num_indexed_ < map_.num_keyframes(); ++num_indexed_) {
    if (is_erased[num_indexed_] != 0) continue;
    places_.Add(num_indexed_, vocabulary_.Describe(map_.features(num_indexed_)));
    indexed_keyframes_.push_back(num_indexed_);
  }
  std::vector<int> keyframes = map_.AliveKeyframes();
  std::stable_sort(keyframes.begin(), keyframes.end(), [&](int a, int b) {
    return std::abs(map_.keyframe(a).frame - frame) < std::abs(map_.keyframe(b).frame - frame);
  });
  keyframes.resize(std::min<size_t>(keyframes.size(), kNearKeyframesToTry));
  for (const int near : keyframes) is_erased[near] = 1;  // Not twice.
  for (const auto& [similarity, keyframe] :
       places_.Rank(vocabulary_.Describe(frames_[frame]), kSimilarKeyframesToTry, is_erased)) {
    keyframes.push_back(keyframe);
  }
  return keyframes;
}

bool MapBuilder::Recognize(int frame) {
  for (const int keyframe : Lookalikes(frame)) {
    FrameTrack track = tracker_.Relocalize(map_, frame, keyframe);
    if (!track.tracked) continue;
    track.missed.clear();
    tracks_[frame] = std::move(track);
    ++num_relocalizations_;
    spdlog::info("frame {} recognised", frame);
    return true;
  }
  return false;
}

bool MapBuilder::BranchAnew() {
  while (next_to_recognize_ < static_cast<int>(frames_.size())) {
    const int frame = next_to_recognize_;
    next_to_recognize_ += kRecoverStep;
    if (!IsFree(frame) || !Recognize(frame)) continue;
    BeginLeg(frame, +1);
    BeginLeg(frame, -1);
    return true;
  }
  return false;
}

bool MapBuilder::GrowByOne() {
  while (!legs_.empty() || BranchAnew()) {
    Leg& leg = legs_.back();
    if (IsFree(leg.frame)) {
      if (TrackFrame(leg.frame, leg.direction)) {
        leg.frame += leg.direction;
        return true;
      }
      spdlog::info("tracking lost at frame {}", leg.frame);
    }
    EndLeg();
  }
  return false;
}

void MapBuilder::IndexPlaces() {
  places_ = PlaceIndex(vocabulary_);
  for (const int k : indexed_keyframes_) places_.Add(k, vocabulary_.Describe(map_.features(k)));
}

void MapBuilder::Restore(const Snapshot& snapshot) {
  map_ = snapshot.map;
  tracks_ = snapshot.tracks;
  num_relocalizations_ = snapshot.num_relocalizations;
}

void MapBuilder::Absorb(const MapBuilder& other, const Similarity3& this_from_other) {
  const int first_keyframe = map_.num_keyframes();
  const int first_point = map_.num_points();
  map_.Append(other.map_, this_from_other);
  for (size_t i = 0; i < tracks_.size(); ++i) {
    if (!other.tracks_[i].tracked) continue;
    FrameTrack track = other.tracks_[i];
    track.cam_from_world = TransformCameraPose(this_from_other, track.cam_from_world);
    track.cam_from_reference.translation *= this_from_other.scale;
    track.reference_keyframe += first_keyframe;
    for (PointMatch& match : track.matches) match.point += first_point;
    tracks_[i] = std::move(track);
  }
  num_relocalizations_ += other.num_relocalizations_;
}

}  // namespace s3lam
