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

std::optional<int> ClassResolver::IndexOf(int64_t label, const std::string& where,
                                          std::optional<bool> is_thing) const {
  int64_t class_id = label;
  if (!map_.IsIdentity()) {
    const std::optional<int> translated = Translate(label, where, is_thing);
    if (!translated) return std::nullopt;
    class_id = *translated;
  }
  const std::optional<int> index = IndexInTable(table_, class_id);
  if (!index) {
    ThrowInputError("{}: class {} is not in the class table '{}'{}", where, class_id, table_.name,
                    map_.IsIdentity() ? ": give the masks' own table, or --label-map"
                                      : fmt::format(", which the label map {} names", map_.source));
  }
  if (is_thing) CheckKind(*index, *is_thing, label, where);
  return index;
}

std::optional<int> ClassResolver::Translate(int64_t label, const std::string& where,
                                            std::optional<bool> is_thing) const {
  const bool is_apart = map_.NumbersStuffApart();
  if (is_apart && !is_thing) {
    ThrowInputError(
        "{}: no isthing says whether label {} is of a thing or of stuff, which the label map {} "
        "numbers apart",
        where, label, map_.source);
  }
  const bool is_stuff = is_apart && !*is_thing;
  const LabelMap::Classes& classes = is_stuff ? map_.class_of_stuff : map_.class_of_label;
  const auto it = classes.find(label);
  if (it == classes.end()) {
    const char* of_kind = is_stuff ? ", among stuff" : ", among things";
    ThrowInputError("{}: label {} is not in the label map {}{}", where, label, map_.source,
                    is_apart ? of_kind : "");
  }
  return it->second;
}

void ClassResolver::CheckKind(int class_index, bool is_thing, int64_t label,
                              const std::string& where) const {
  if (IsThing(class_index) == is_thing) return;
  const SemanticClass& c = table_.classes[static_cast<size_t>(class_index)];
  constexpr const char* kAdvice =
      ": if stuff is numbered apart from things, give a --label-map that has a table of each, such "
      "as coco_separated";
  ThrowInputError(
      "{}: isthing is {}, but label {} means class {} ({}), which is {} in the class table '{}'{}",
      where, is_thing, label, c.id, c.name, c.is_thing ? "a thing" : "stuff", table_.name,
      map_.NumbersStuffApart() ? "" : kAdvice);
}

}  // namespace s3lam
