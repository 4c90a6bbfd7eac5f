#pragma once

#include <functional>
#include <vector>

#include "s3lam/slam/initializer.h"
#include "s3lam/slam/mapper.h"
#include "s3lam/slam/place_recognition.h"
#include "s3lam/slam/tracker.h"

namespace s3lam {

/// Builds a map from the features of a whole sequence: starts at an initial pair, follows the
/// frames in both directions, and after a loss goes on wherever a frame is recognised, filling the
/// gap from both ends. Frames that belong to another map are left alone.
class MapBuilder {
 public:
  using ProgressCallback = std::function<void(int frames_done, int keyframes)>;

  MapBuilder(const TrackerOptions& tracker_options, const MapperOptions& mapper_options,
             const FeatureOptions& feature_options, std::vector<FrameFeatures>& frames,
             const Undistorter& undistorter, const Vocabulary& vocabulary,
             std::vector<uint8_t> frame_is_taken, ProgressCallback progress);

  /// Makes the first two keyframes and their points.
  void Start(const InitialPair& pair);
  /// Tracks and maps everything that can be reached.
  void Grow();
  /// Takes over what another map of the same sequence has, moved into this world.
  void Absorb(const MapBuilder& other, const Similarity3& this_from_other);

  [[nodiscard]] Map& map() { return map_; }
  [[nodiscard]] const Map& map() const { return map_; }
  [[nodiscard]] const Mapper& mapper() const { return mapper_; }
  [[nodiscard]] const Tracker& tracker() const { return tracker_; }
  /// One per frame.
  [[nodiscard]] const std::vector<FrameTrack>& tracks() const { return tracks_; }
  [[nodiscard]] std::vector<FrameTrack>& tracks() { return tracks_; }
  [[nodiscard]] int NumTracked() const;
  [[nodiscard]] bool IsTracked(int frame) const;
  [[nodiscard]] const InitialPair& initial_pair() const { return initial_; }
  [[nodiscard]] int num_relocalizations() const { return num_relocalizations_; }

 private:
  /// Follows frames from `first` in steps of +1 or -1 until the end, a tracked frame or a loss;
  /// returns the first frame not tracked.
  int Follow(int first, int direction);
  /// Looks for a frame in the map by its looks alone.
  bool Recognize(int frame);
  /// The keyframes that a frame is compared with: nearest in time, and most like it.
  std::vector<int> Lookalikes(int frame);
  bool TrackFrame(int frame, int direction);
  void MakeKeyframe(int frame);
  [[nodiscard]] Rigid3 PredictPose(int frame, int direction) const;
  [[nodiscard]] bool IsFree(int frame) const;

  const std::vector<FrameFeatures>& frames_;
  Map map_;
  Tracker tracker_;
  Mapper mapper_;
  const Vocabulary& vocabulary_;
  PlaceIndex places_;    // Of the keyframes,
  int num_indexed_ = 0;  // the first so many of them.
  std::vector<uint8_t> frame_is_taken_;
  ProgressCallback progress_;
  InitialPair initial_;
  std::vector<FrameTrack> tracks_;
  int last_keyframe_frame_ = kNoIndex;
  int frames_done_ = 0;
  int num_relocalizations_ = 0;
};

}  // namespace s3lam
