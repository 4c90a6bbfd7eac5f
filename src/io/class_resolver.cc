#include "class_resolver.h"

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

std::optional<int> IndexInTable(const ClassTable& table, int64_t class_id) {
  const auto id = static_cast<int>(class_id);
  return id == class_id ? table.IndexOfId(id) : std::nullopt;
}

}  // namespace

bool ClassResolver::Knows(int64_t label) const {
  return map_.IsIdentity() ? IndexInTable(table_, label).has_value()
                           : map_.class_of_label.contains(label);
}

std::optional<int> ClassResolver::IndexOf(int64_t label, const std::string& where) const {
  int64_t class_id = label;
  if (!map_.IsIdentity()) {
    const auto it = map_.class_of_label.find(label);
    if (it == map_.class_of_label.end()) {
      ThrowInputError("{}: label {} is not in the label map {}", where, label, map_.source);
    }
    if (!it->second) return std::nullopt;
    class_id = *it->second;
  }
  const std::optional<int> index = IndexInTable(table_, class_id);
  if (!index) {
    ThrowInputError("{}: class {} is not in the class table '{}'{}", where, class_id, table_.name,
                    map_.IsIdentity() ? ": give the masks' own table, or --label-map"
                                      : fmt::format(", which the label map {} names", map_.source));
  }
  return index;
}

}  // namespace s3lam
