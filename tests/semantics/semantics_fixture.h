#pragma once

#include <map>
#include <utility>
#include <vector>

#include "s3lam/semantics/mask_observations.h"

namespace s3lam::testing {

/// Builds MaskObservations by hand: frames of segments, and points that lie in them.
class ObservationBuilder {
 public:
  /// Adds a segment and returns its index. Frames must not decrease.
  int32_t AddSegment(uint32_t frame, int class_index, double score = 1.0) {
    while (result_.frames.size() <= frame) {
      result_.frames.emplace_back(static_cast<uint32_t>(result_.frames.size() + 1));
    }
    const auto index = static_cast<uint32_t>(result_.segments.size());
    PanopticSegment label;
    label.class_index = class_index;
    label.score = score;
    result_.segments.push_back({{result_.frames[frame], index + 100}, frame, label, {}});
    return static_cast<int32_t>(index);
  }

  /// Adds a point seen in these segments (each the frame's own), and returns its row.
  uint32_t AddPoint(const std::vector<int32_t>& segments, bool near_border = false) {
    const auto row = static_cast<uint32_t>(result_.points.size());
    result_.points.emplace_back(row + 1000);
    if (result_.first_observation.empty()) result_.first_observation.push_back(0);
    for (const int32_t s : segments) {
      SegmentNode& segment = result_.segments.at(static_cast<size_t>(s));
      segment.points.push_back(row);
      result_.observations.push_back({segment.frame, s, near_border});
    }
    result_.first_observation.push_back(static_cast<uint32_t>(result_.observations.size()));
    return row;
  }

  [[nodiscard]] MaskObservations& result() { return result_; }

 private:
  MaskObservations result_;
};

}  // namespace s3lam::testing
