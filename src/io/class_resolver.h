#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "s3lam/io/label_map.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// From the labels in a mask to indices into the class table.
class ClassResolver {
 public:
  ClassResolver(ClassTable table, LabelMap map) : table_(std::move(table)), map_(std::move(map)) {}

  [[nodiscard]] const ClassTable& table() const { return table_; }
  [[nodiscard]] const LabelMap& map() const { return map_; }
  [[nodiscard]] bool IsThing(int class_index) const {
    return table_.classes[static_cast<size_t>(class_index)].is_thing;
  }

  /// True if the label map or, without one, the class table has this label.
  [[nodiscard]] bool Knows(int64_t label) const;

  /// Index of the class; empty if the label map says that the label is void. Throws InputError
  /// beginning with `where` for a label, or a class it is mapped to, that is unknown. `is_thing` is
  /// what the mask says of the label: it must be known where the label map numbers stuff apart, and
  /// a class of the other kind throws as well.
  [[nodiscard]] std::optional<int> IndexOf(int64_t label, const std::string& where,
                                           std::optional<bool> is_thing = std::nullopt) const;

 private:
  [[nodiscard]] std::optional<int> Translate(int64_t label, const std::string& where,
                                             std::optional<bool> is_thing) const;
  void CheckKind(int class_index, bool is_thing, int64_t label, const std::string& where) const;

  ClassTable table_;
  LabelMap map_;
};

}  // namespace s3lam
