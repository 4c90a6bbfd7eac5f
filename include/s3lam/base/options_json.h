#pragma once

#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <string_view>

#include "s3lam/base/options.h"

namespace s3lam {

namespace internal {
/// A type-erased options struct, so that the code below is compiled once.
class OptionsRef {
 public:
  template <VisitableOptions T>
  explicit OptionsRef(T& options)
      : object_(&options),
        visit_([](void* object, OptionVisitor& v) { static_cast<T*>(object)->Visit(v); }) {}
  void Visit(OptionVisitor& visitor) const { visit_(object_, visitor); }

 private:
  void* object_;
  void (*visit_)(void*, OptionVisitor&);
};
nlohmann::json OptionsToJson(OptionsRef options);
void OptionsFromJson(const nlohmann::json& json, OptionsRef options, std::string_view source);
void SetOption(std::string_view assignment, OptionsRef options);
void CheckOptions(OptionsRef options);
std::string DescribeOptions(OptionsRef options);
}  // namespace internal

/// All fields, nested as in the struct.
template <VisitableOptions T>
nlohmann::json OptionsToJson(const T& options) {
  T copy = options;
  return internal::OptionsToJson(internal::OptionsRef(copy));
}

/// Sets the fields that `json` has. Strict: an unknown key, a value of the wrong type or out of
/// bounds throws UsageError naming `source`, the key's path and, for an unknown key, the nearest
/// known one; the options are then unchanged.
template <VisitableOptions T>
void OptionsFromJson(const nlohmann::json& json, T& options, std::string_view source) {
  T copy = options;
  internal::OptionsFromJson(json, internal::OptionsRef(copy), source);
  options = copy;
}

/// Applies "key.path=value", value being JSON or else taken as a string. Throws as above.
template <VisitableOptions T>
void SetOption(std::string_view assignment, T& options) {
  T copy = options;
  internal::SetOption(assignment, internal::OptionsRef(copy));
  options = copy;
}

/// Throws UsageError naming the first field that is out of its bounds (or not finite).
template <VisitableOptions T>
void CheckOptions(const T& options) {
  T copy = options;
  internal::CheckOptions(internal::OptionsRef(copy));
}

/// Two lines per field, "key.path = default" and, indented, its sentence, for --help.
template <VisitableOptions T>
std::string DescribeOptions(const T& options) {
  T copy = options;
  return internal::DescribeOptions(internal::OptionsRef(copy));
}

/// The member of `known` with the smallest edit distance to `word`; empty if `known` is.
std::string NearestWord(std::string_view word, std::span<const std::string> known);

}  // namespace s3lam
