#pragma once

#include <vector>

#include "s3lam/slam/mapper.h"
#include "s3lam/slam/place_recognition.h"
#include "s3lam/slam/place_verification.h"

namespace s3lam {

struct LoopClosingOptions {
  bool enabled = true;
  int candidates = 5;
  int min_frame_gap = 30;
  int max_rounds = 3;
  double max_lost_share = 0.03;
  double min_surviving_share = 0.5;
  PlaceVerificationOptions verification;

  void Visit(OptionVisitor& v);
};

/// A place that was seen twice, by frame.
struct LoopReport {
  int frame_a = -1;
  int frame_b = -1;
  int num_points = 0;
  double correction_deg = 0.0;    // What the drift between the two had come to: rotation,
  double correction_share = 0.0;  // translation, in median depths of frame a,
  double correction_scale = 1.0;  // and scale.
};

struct LoopClosingReport {
  std::vector<LoopReport> closed;
  int num_rejected = 0;  // Found, but not closed, or undone: the map does not bear them.

  template <typename A>
  void Transfer(A& archive) {
    archive(closed, num_rejected);
  }
};

/// Looks, for every keyframe, for others that show the same place without being connected to it,
/// and closes all loops found at once: drift is spread by a pose graph over similarities, the
/// points of both sides are fused, everything is adjusted. A loop is torn if less than
/// min_surviving_share of the points that it joined are still seen from both sides then. If there
/// are such, or the map lost more of its observations than max_lost_share, the loops contradict it:
/// it is tried again without those that were torn, and left as it was if nothing helps. Repeated
/// while it finds loops. `tracks` move with their keyframes.
LoopClosingReport CloseLoops(const LoopClosingOptions& options, const Vocabulary& vocabulary,
                             const Undistorter& undistorter, const Mapper& mapper,
                             int global_rounds, int num_threads, Map& map,
                             std::vector<FrameTrack>& tracks);

/// What a match joins: pairs of points that are the same, with the keyframes that saw each before
/// they were made one.
class Bridge {
 public:
  /// `match` is between keyframes of one map, whose points are not fused yet.
  Bridge(const Map& map, const PlaceMatch& match);

  /// Share of the pairs that are one point of the map now, seen from both sides.
  [[nodiscard]] double SurvivingShare(const Map& map) const;

 private:
  struct Pair {
    int point_a = kNoIndex;
    int point_b = kNoIndex;
    std::vector<int> observers_a;  // Ascending.
    std::vector<int> observers_b;
  };
  std::vector<Pair> pairs_;
};

/// Makes one of the points that a verified match says are the same, and fuses the neighbourhoods of
/// its keyframes, which must lie together already.
void FuseMatch(const Mapper& mapper, int neighbours, const PlaceMatch& match, Map& map);

}  // namespace s3lam
