#pragma once

#include <cstdint>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/semantics/mask_observations.h"

namespace s3lam {

inline constexpr int32_t kNoInstance = -1;

/// Which object of the scene each frame-local segment shows.
struct InstanceAssignment {
  std::vector<int32_t> instance_of_segment;  // kNoInstance for a segment that tells nothing.
  int32_t num_instances = 0;
};

struct TrackingOptions {
  double min_iou_previous = 0.65;
  double min_iou_before = 0.40;

  void Visit(OptionVisitor& v);
};

/// The paper's tracking of ids: a segment continues the instance of the segment of its class with
/// which it has the greatest IoU, if that is above min_iou_previous in the frame before, or else
/// above min_iou_before in the one before that; otherwise it starts a new instance. No two segments
/// of a frame share an instance (the greater IoU has it). Needs MaskObservations::overlaps.
InstanceAssignment TrackInstances(const MaskObservations& observations,
                                  const TrackingOptions& options);

struct ConsensusOptions {
  int min_segment_points = 3;
  double visible_ratio = 0.3;
  int visible_points = 10;
  double containment = 0.8;
  double max_split_rate = 0.3;
  double min_consensus = 0.8;
  int min_observers = 2;

  void Visit(OptionVisitor& v);
};

/// Clusters the segments of all frames at once by view consensus (after Yan et al., MaskClustering,
/// CVPR 2024, with point tracks in place of depth). A view observes a set of points if it sees
/// enough of them, and supports that two sets belong together if both lie, for the most part, in
/// the same segment of its own. Segments that many views split are under-segmented and left out.
/// The rest are merged while the share of supporters among the common observers is high, the best
/// observed pairs first. Neither order nor class of the segments matters.
InstanceAssignment ClusterByConsensus(const MaskObservations& observations,
                                      const ConsensusOptions& options);

}  // namespace s3lam
