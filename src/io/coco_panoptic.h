#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "segments_json.h"

namespace s3lam {

/// The segments of one mask, or what is wrong with its entry.
struct CocoAnnotation {
  SegmentTable table;
  std::string defect;  // Empty if the entry is sound.
};

/// Annotations of a COCO panoptic JSON by file_name. Throws InputError if the document as a whole
/// is not one; a defect of one entry is kept with the entry.
std::map<std::string, CocoAnnotation> ReadCocoAnnotations(const std::filesystem::path& path,
                                                          const ClassResolver& classes);

}  // namespace s3lam
