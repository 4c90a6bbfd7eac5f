#include <algorithm>
#include <array>
#include <set>
#include <span>

#include "s3lam/semantics/instances.h"

namespace s3lam {
namespace {

/// Gives the segments of one frame the instances of the segments they overlap most, greatest IoU
/// first; those with one already, and instances in `taken`, are left alone.
void ContinueInstances(std::vector<SegmentOverlap> candidates,
                       std::vector<int32_t>& instance_of_segment, std::set<int32_t>& taken) {
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b) { return a.iou > b.iou; });
  for (const SegmentOverlap& candidate : candidates) {
    int32_t& instance = instance_of_segment[candidate.segment];
    const int32_t wanted = instance_of_segment[candidate.other];
    if (instance == kNoInstance && taken.insert(wanted).second) instance = wanted;
  }
}

}  // namespace

void TrackingOptions::Visit(OptionVisitor& v) {
  v.Value("min_iou_previous", min_iou_previous,
          "IoU with a segment of the previous mask above which it is the same object.", 0.0, 1.0);
  v.Value("min_iou_before", min_iou_before, "The same for the mask before the previous one.", 0.0,
          1.0);
}

InstanceAssignment TrackInstances(const MaskObservations& observations,
                                  const TrackingOptions& options) {
  InstanceAssignment result;
  const size_t num_segments = observations.segments.size();
  result.instance_of_segment.assign(num_segments, kNoInstance);
  const std::array<double, 2> min_iou = {options.min_iou_previous, options.min_iou_before};
  size_t overlap = 0;
  for (size_t begin = 0; begin < num_segments;) {
    size_t end = begin;
    while (end < num_segments &&
           observations.segments[end].frame == observations.segments[begin].frame) {
      ++end;
    }
    std::array<std::vector<SegmentOverlap>, 2> candidates;
    for (; overlap < observations.overlaps.size() && observations.overlaps[overlap].segment < end;
         ++overlap) {
      const SegmentOverlap& o = observations.overlaps[overlap];
      const size_t k = o.frames_apart - 1;
      if (o.iou > min_iou[k]) candidates[k].push_back(o);
    }
    std::set<int32_t> taken;
    for (const auto& list : candidates) ContinueInstances(list, result.instance_of_segment, taken);
    for (size_t s = begin; s < end; ++s) {
      int32_t& instance = result.instance_of_segment[s];
      if (instance == kNoInstance) instance = result.num_instances++;
    }
    begin = end;
  }
  return result;
}

}  // namespace s3lam
