#pragma once

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
  MapBuilder(const TrackerOptions& tracker_options, const MapperOptions& mapper_options,
             const FeatureOptions& feature_options, std::vector<FrameFeatures>& frames,
             const Undistorter& undistorter, const Vocabulary& vocabulary,
             std::vector<uint8_t> frame_is_taken);

  /// Makes the first two keyframes and their points.
  void Start(const InitialPair& pair);
  /// Tracks and maps the next frame that can be reached; false if there is none.
  bool GrowByOne();
  /// All that can be reached.
  void Grow() {
    while (GrowByOne()) {
    }
  }
  /// A state to go back to.
  struct Snapshot {
    Map map;
    std::vector<FrameTrack> tracks;
    int num_relocalizations = 0;
  };
  [[nodiscard]] Snapshot Keep() const { return {map_, tracks_, num_relocalizations_}; }
  void Restore(const Snapshot& snapshot);
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

  /// All that Start and GrowByOne have come to; into a builder made with the same arguments.
  template <typename A>
  void Transfer(A& archive) {
    archive(map_, mapper_, indexed_keyframes_, num_indexed_, frame_is_taken_, initial_, tracks_,
            legs_, next_to_recognize_, last_keyframe_frame_, num_relocalizations_);
    if constexpr (A::kReads) IndexPlaces();
  }

 private:
  /// Frames to be followed from `frame` on, in steps of +1 or -1, until the end, a tracked frame or
  /// a loss. `origin` is where the leg began: a frame that is tracked already.
  struct Leg {
    int origin = kNoIndex;
    int frame = kNoIndex;
    int direction = 0;
  };

  void BeginLeg(int origin, int direction);
  void EndLeg();
  /// Goes on wherever a frame is recognised, after a loss; false if none is.
  bool BranchAnew();
  void IndexPlaces();
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
  PlaceIndex places_;                   // Of these keyframes,
  std::vector<int> indexed_keyframes_;  // those that were alive
  int num_indexed_ = 0;                 // among the first so many.
  std::vector<uint8_t> frame_is_taken_;
  InitialPair initial_;
  std::vector<FrameTrack> tracks_;
  std::vector<Leg> legs_;      // Still to be followed, the present one last.
  int next_to_recognize_ = 0;  // The frame at which to look for further ones.
  int last_keyframe_frame_ = kNoIndex;
  int num_relocalizations_ = 0;
};

}  // namespace s3lam
