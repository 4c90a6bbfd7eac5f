#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>

namespace s3lam {

/// Translates the labels in masks into ids of the class table. The empty map leaves them as they
/// are.
struct LabelMap {
  /// Class id by label; empty for a label that is void.
  using Classes = std::map<int64_t, std::optional<int>>;

  std::string source;      // File it came from, for messages.
  Classes class_of_label;  // Of things alone, if stuff is numbered apart.
  /// Empty unless stuff is numbered apart, so that one label is of two classes.
  Classes class_of_stuff = {};

  [[nodiscard]] bool IsIdentity() const { return class_of_label.empty(); }
  [[nodiscard]] bool NumbersStuffApart() const { return !class_of_stuff.empty(); }
};

/// Reads a label map; throws InputError naming the file and the entry:
///   *.json   {"label": class id or null (void), ...}; where stuff is numbered apart from things
///            (detectron2's Panoptic FPN) a table of each: {"things": {...}, "stuff": {...}}
///   *.tsv    a table with columns "id" and "nyu40id", as ScanNet has it; class 0 is void
LabelMap ReadLabelMap(const std::filesystem::path& path);

}  // namespace s3lam
