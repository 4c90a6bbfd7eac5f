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
  double disagreement = 1.0;
  double predicted_weight = 0.3;
  double other_class_weight = 0.25;
  double min_agreement = 1.0;
  int max_partners = 30;
  int window = 128;

  void Visit(OptionVisitor& v);
};

/// Clusters the segments of all frames at once by the consensus of the views. Two frames that see
/// the same points vote on every pair of their segments: points that both put into the pair speak
/// for one object (less so if the two are of different classes: where an object was missed, it is
/// often part of what surrounds it), points that they put elsewhere against it; two segments of one
/// frame speak against each other with all their points. The objects are the parts of that signed
/// graph, found by joining the most agreed pair again and again, votes adding up. So a segment that
/// merges two objects, splits one or misses one is outvoted. The order of frames does not matter, but that
/// runs of `window` frames are joined among themselves before all are. (View consensus as in
/// MaskClustering, CVPR 2024, with point tracks in place of depth, and correlation clustering in
/// place of thresholds.)
InstanceAssignment ClusterByConsensus(const MaskObservations& observations,
                                      const ConsensusOptions& options, int num_threads);

}  // namespace s3lam
