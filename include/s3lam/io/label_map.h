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
  std::string source;  // File it came from, for messages.
  /// Class id by label; empty for a label that is void.
  std::map<int64_t, std::optional<int>> class_of_label;

  [[nodiscard]] bool IsIdentity() const { return class_of_label.empty(); }
};

/// Reads a label map; throws InputError naming the file and the entry:
///   *.json   {"label": class id or null (void), ...}
///   *.tsv    a table with columns "id" and "nyu40id", as ScanNet has it; class 0 is void
LabelMap ReadLabelMap(const std::filesystem::path& path);

}  // namespace s3lam
