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

/// How a format lists segments.
struct SegmentRules {
  uint32_t min_id = 0;  // Both are allowed.
  uint32_t max_id = 0;
  /// Whether isthing is looked at: to tell a thing's category_id from that of stuff where the label
  /// map has a table of each, and against the kind of the class.
  bool has_kinds = false;
};

/// Parses a list of segments: {id, category_id or label_id, isthing?, score?, iscrowd?, was_fused?,
/// distribution?}. A distribution is a list in the order of the class table, or an object
/// {label: probability}; with one the category may be missing. Throws InputError beginning with
/// `where` for anything missing, repeated, out of range or, if it is looked at, an isthing that the
/// class table contradicts.
SegmentTable ParseSegments(const nlohmann::json& list, const ClassResolver& classes,
                           const SegmentRules& rules, const std::string& where);

}  // namespace s3lam
