#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <set>
#include <string>

#include "class_resolver.h"
#include "s3lam/scene/panoptic_frame.h"

namespace s3lam {

/// What JSON says of the segments of one mask.
struct SegmentTable {
  std::map<uint32_t, PanopticSegment> segments;
  std::set<uint32_t> void_segments;  // Listed, but the label map makes their class void.
};

/// Parses a list of segments: {id, category_id or label_id, score?, iscrowd?, was_fused?,
/// distribution?}. A distribution is a list in the order of the class table, or an object
/// {label: probability}; with one the category may be missing. Throws InputError beginning with
/// `where` for anything missing, repeated or out of range; ids must be in [min_id, max_id].
SegmentTable ParseSegments(const nlohmann::json& list, const ClassResolver& classes,
                           uint32_t min_id, uint32_t max_id, const std::string& where);

}  // namespace s3lam
