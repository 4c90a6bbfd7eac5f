#pragma once

#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace s3lam {

class OptionVisitor;

/// An options struct lists its fields once, in `void Visit(OptionVisitor&)`; reading, writing,
/// checking and documenting all follow from that list.
template <typename T>
concept VisitableOptions = requires(T& options, OptionVisitor& visitor) {
  options.Visit(visitor);
};

/// Receives every field of an options struct: its key, a reference, its bounds and one sentence
/// (with the unit in square brackets where it has one).
class OptionVisitor {
 public:
  virtual ~OptionVisitor() = default;

  virtual void Value(std::string_view key, bool& value, std::string_view doc) = 0;
  virtual void Value(std::string_view key, int& value, std::string_view doc,
                     int min = std::numeric_limits<int>::lowest(),
                     int max = std::numeric_limits<int>::max()) = 0;
  virtual void Value(std::string_view key, double& value, std::string_view doc,
                     double min = std::numeric_limits<double>::lowest(),
                     double max = std::numeric_limits<double>::max()) = 0;
  virtual void Value(std::string_view key, std::string& value, std::string_view doc) = 0;
  virtual void Value(std::string_view key, std::vector<std::string>& value,
                     std::string_view doc) = 0;
  virtual void Value(std::string_view key, std::vector<double>& value, std::string_view doc) = 0;

  /// An enumeration whose values 0, 1, ... have these names.
  template <typename Enum>
  requires std::is_enum_v<Enum>
  void Choice(std::string_view key, Enum& value, std::span<const std::string_view> names,
              std::string_view doc) {
    int index = static_cast<int>(value);
    ChoiceIndex(key, index, names, doc);
    value = static_cast<Enum>(index);
  }

  /// A nested options struct.
  template <VisitableOptions T>
  void Group(std::string_view key, T& options, std::string_view doc) {
    if (!BeginGroup(key, doc)) return;
    options.Visit(*this);
    EndGroup();
  }

 protected:
  virtual void ChoiceIndex(std::string_view key, int& index,
                           std::span<const std::string_view> names, std::string_view doc) = 0;
  /// False skips the group.
  virtual bool BeginGroup(std::string_view key, std::string_view doc) = 0;
  virtual void EndGroup() = 0;
};

}  // namespace s3lam
