#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "s3lam/scene/panoptic_frame.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// The segments of one mask, or what is wrong with its entry.
struct CocoAnnotation {
  std::map<uint32_t, PanopticSegment> segments;
  std::string defect;  // Empty if the entry is sound.
};

/// Annotations of a COCO panoptic JSON by file_name. Throws InputError if the document as a whole
/// is not one; a defect of one entry is kept with the entry.
std::map<std::string, CocoAnnotation> ReadCocoAnnotations(const std::filesystem::path& path,
                                                          const ClassTable& class_table);

}  // namespace s3lam
