#pragma once

#include <cstdint>
#include <vector>

#include "s3lam/semantics/instances.h"

namespace s3lam {

/// A weight that goes with a segment or a frame.
struct Weighted {
  uint32_t id = 0;
  float weight = 0.0F;
};
using WeightedList = std::vector<Weighted>;

/// What frames see in common, for votes on pairs of their segments; border and void observations
/// and crowds left out.
class CommonViews {
 public:
  /// A point seen in a segment.
  struct Sighting {
    uint32_t row = 0;
    uint32_t segment = 0;
    float weight = 0.0F;
  };

  CommonViews(const MaskObservations& observations, const ConsensusOptions& options,
              int num_threads);

  [[nodiscard]] uint32_t num_frames() const { return static_cast<uint32_t>(sightings_.size()); }
  [[nodiscard]] uint32_t num_segments() const { return first_segment_.back(); }
  /// Of a frame; that of the frame behind the last one is the number of segments.
  [[nodiscard]] uint32_t FirstSegmentOf(uint32_t frame) const { return first_segment_[frame]; }

 private:
  friend class VoteCounter;

  size_t num_rows_ = 0;
  std::vector<std::vector<Sighting>> sightings_;  // Of each frame, by row.
  std::vector<uint32_t> first_segment_;
  std::vector<std::vector<uint32_t>> partners_;  // The later frames that each is compared with.
  std::vector<int> class_of_segment_;
  float disagreement_;
  float other_class_weight_;
};

/// Counts the votes of pairs of frames; has room of its own, so each thread needs one.
class VoteCounter {
 public:
  explicit VoteCounter(const CommonViews& views);

  /// For each segment of the frame its votes with segments behind it of the frames [begin, end),
  /// its own among them. The weight is positive where two frames find the two to be one object.
  [[nodiscard]] std::vector<WeightedList> Count(uint32_t frame, uint32_t begin, uint32_t end);

 private:
  void CountOwn(uint32_t frame, std::vector<WeightedList>& votes);
  void CountPair(uint32_t frame, uint32_t other, std::vector<WeightedList>& votes);

  const CommonViews& views_;
  std::vector<uint32_t> first_sighting_;  // By row, of the frame at hand; kNone elsewhere.
  // Of the pair at hand: points that two segments share, and that the other frame sees of each.
  std::vector<float> common_;
  std::vector<float> seen_;
  std::vector<float> seen_of_other_;
};

}  // namespace s3lam
