#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/scene/probability_volume.h"

namespace s3lam {

/// Segment id of every pixel, image row = matrix row.
using SegmentImage = Eigen::Matrix<uint32_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A pixel of a SegmentImage that belongs to no segment (void).
inline constexpr uint32_t kNoSegment = std::numeric_limits<uint32_t>::max();

/// What a panoptic segmentation says of one segment.
struct PanopticSegment {
  int class_index = 0;    // Into the class table.
  double score = 1.0;     // Confidence in (0, 1].
  bool is_crowd = false;  // A group of things that are not told apart.
  /// Probability by class index, summing to one; empty if only class_index and score are known.
  std::vector<float> distribution;
};

/// The panoptic segmentation of one image. Ids are local to it.
struct PanopticFrame {
  std::string source;  // File it came from, for messages.
  SegmentImage segment_ids;
  std::map<uint32_t, PanopticSegment> segments;    // Every id in segment_ids but kNoSegment.
  std::optional<ProbabilityVolume> probabilities;  // Of the size of segment_ids.
};

}  // namespace s3lam
