#include "s3lam/base/options_json.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

using nlohmann::json;

size_t EditDistance(std::string_view a, std::string_view b) {
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 1; i <= a.size(); ++i) {
    size_t diagonal = row[0];
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t substitute = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, substitute});
    }
  }
  return row.back();
}

/// A value for a message: lists and objects can be of any size, texts of any bytes.
std::string ShortText(const json& value) {
  constexpr size_t kMaxSize = 60;
  if (value.is_structured()) return fmt::format("an {}", value.type_name());
  const std::string text =
      value.dump(-1, ' ', /*ensure_ascii=*/true, json::error_handler_t::replace);
  return text.size() <= kMaxSize ? text : text.substr(0, kMaxSize) + "...";
}

std::string JoinNames(std::span<const std::string_view> names) {
  return fmt::format("{}", fmt::join(names, "|"));
}

/// Keeps the dotted path of the group being visited.
class PathVisitor : public OptionVisitor {
 protected:
  bool BeginGroup(std::string_view key, std::string_view) override {
    groups_.emplace_back(key);
    return true;
  }
  void EndGroup() override { groups_.pop_back(); }

  [[nodiscard]] std::string Path(std::string_view key) const {
    std::string path;
    for (const std::string& group : groups_) path += group + ".";
    return path.append(key);
  }

 private:
  std::vector<std::string> groups_;
};

class JsonWriter final : public OptionVisitor {
 public:
  json root = json::object();

  void Value(std::string_view key, bool& value, std::string_view) override { Put(key, value); }
  void Value(std::string_view key, int& value, std::string_view, int, int) override {
    Put(key, value);
  }
  void Value(std::string_view key, double& value, std::string_view, double, double) override {
    Put(key, value);
  }
  void Value(std::string_view key, std::string& value, std::string_view) override {
    Put(key, value);
  }
  void Value(std::string_view key, std::vector<std::string>& value, std::string_view) override {
    Put(key, value);
  }
  void Value(std::string_view key, std::vector<double>& value, std::string_view) override {
    Put(key, value);
  }

 protected:
  void ChoiceIndex(std::string_view key, int& index, std::span<const std::string_view> names,
                   std::string_view) override {
    Put(key, std::string(names[static_cast<size_t>(index)]));
  }
  bool BeginGroup(std::string_view key, std::string_view) override {
    json& group = (*stack_.back())[std::string(key)];
    group = json::object();
    stack_.push_back(&group);
    return true;
  }
  void EndGroup() override { stack_.pop_back(); }

 private:
  template <typename T>
  void Put(std::string_view key, const T& value) {
    (*stack_.back())[std::string(key)] = value;
  }
  std::vector<json*> stack_{&root};
};

class BoundsChecker final : public PathVisitor {
 public:
  explicit BoundsChecker(std::string_view source) : source_(source) {}

  void Value(std::string_view, bool&, std::string_view) override {}
  void Value(std::string_view key, int& value, std::string_view, int min, int max) override {
    if (value < min || value > max) Fail(key, value, min, max);
  }
  void Value(std::string_view key, double& value, std::string_view, double min,
             double max) override {
    if (!std::isfinite(value) || value < min || value > max) Fail(key, value, min, max);
  }
  void Value(std::string_view, std::string&, std::string_view) override {}
  void Value(std::string_view, std::vector<std::string>&, std::string_view) override {}
  void Value(std::string_view, std::vector<double>&, std::string_view) override {}

 protected:
  void ChoiceIndex(std::string_view, int&, std::span<const std::string_view>,
                   std::string_view) override {}

 private:
  template <typename T>
  [[noreturn]] void Fail(std::string_view key, T value, T min, T max) const {
    throw UsageError(
        fmt::format("{}: {} = {} is outside [{}, {}]", source_, Path(key), value, min, max));
  }
  std::string source_;
};

class JsonReader final : public OptionVisitor {
 public:
  JsonReader(const json& root, std::string_view source) : source_(source) { Push(root, ""); }

  void Value(std::string_view key, bool& value, std::string_view) override {
    Take(key, value, "true or false", [](const json& j) { return j.is_boolean(); });
  }
  void Value(std::string_view key, int& value, std::string_view, int, int) override {
    Take(key, value, "an integer", [](const json& j) {
      return j.is_number_integer() && j.get<double>() >= std::numeric_limits<int>::min() &&
             j.get<double>() <= std::numeric_limits<int>::max();
    });
  }
  void Value(std::string_view key, double& value, std::string_view, double, double) override {
    Take(key, value, "a number", [](const json& j) { return j.is_number(); });
  }
  void Value(std::string_view key, std::string& value, std::string_view) override {
    Take(key, value, "a string", [](const json& j) { return j.is_string(); });
  }
  void Value(std::string_view key, std::vector<std::string>& value, std::string_view) override {
    Take(key, value, "a list of strings", [](const json& j) {
      return j.is_array() && std::all_of(j.begin(), j.end(), [](auto& x) { return x.is_string(); });
    });
  }
  void Value(std::string_view key, std::vector<double>& value, std::string_view) override {
    Take(key, value, "a list of numbers", [](const json& j) {
      return j.is_array() && std::all_of(j.begin(), j.end(), [](auto& x) { return x.is_number(); });
    });
  }

  /// Call after the visit: throws on keys nobody asked for.
  void Finish() { Pop(); }

 protected:
  void ChoiceIndex(std::string_view key, int& index, std::span<const std::string_view> names,
                   std::string_view) override {
    std::string name(names[static_cast<size_t>(index)]);
    const std::string expected = "one of " + JoinNames(names);
    Take(key, name, expected, [&](const json& j) {
      return j.is_string() &&
             std::find(names.begin(), names.end(), j.get<std::string>()) != names.end();
    });
    index = static_cast<int>(std::find(names.begin(), names.end(), name) - names.begin());
  }
  bool BeginGroup(std::string_view key, std::string_view) override {
    const json* group = Find(key);
    if (group == nullptr) return false;
    Push(*group, levels_.back().path + std::string(key) + ".");
    return true;
  }
  void EndGroup() override { Pop(); }

 private:
  struct Level {
    const json* object;
    std::string path;  // With a trailing dot, or empty at the root.
    std::vector<std::string> known;
  };

  void Push(const json& object, std::string path) {
    if (!object.is_object()) {
      throw UsageError(fmt::format("{}: {} must be a JSON object, got {}", source_,
                                   path.empty() ? "the document" : path.substr(0, path.size() - 1),
                                   object.type_name()));
    }
    levels_.push_back({&object, std::move(path), {}});
  }

  void Pop() {
    const Level& level = levels_.back();
    for (const auto& [key, value] : level.object->items()) {
      if (std::find(level.known.begin(), level.known.end(), key) != level.known.end()) continue;
      throw UsageError(fmt::format("{}: unknown key '{}{}', did you mean '{}{}'?", source_,
                                   level.path, key, level.path, NearestWord(key, level.known)));
    }
    levels_.pop_back();
  }

  const json* Find(std::string_view key) {
    Level& level = levels_.back();
    level.known.emplace_back(key);
    const auto it = level.object->find(std::string(key));
    return it == level.object->end() ? nullptr : &*it;
  }

  template <typename T, typename Predicate>
  void Take(std::string_view key, T& value, std::string_view expected, Predicate&& accepts) {
    const json* found = Find(key);
    if (found == nullptr) return;
    if (!accepts(*found)) {
      throw UsageError(fmt::format("{}: {}{} must be {}, got {}", source_, levels_.back().path, key,
                                   expected, ShortText(*found)));
    }
    value = found->get<T>();
  }

  std::string source_;
  std::vector<Level> levels_;
};

class Describer final : public PathVisitor {
 public:
  std::string text;

  void Value(std::string_view key, bool& value, std::string_view doc) override {
    Line(key, value ? "true" : "false", doc);
  }
  void Value(std::string_view key, int& value, std::string_view doc, int, int) override {
    Line(key, std::to_string(value), doc);
  }
  void Value(std::string_view key, double& value, std::string_view doc, double, double) override {
    Line(key, fmt::format("{}", value), doc);
  }
  void Value(std::string_view key, std::string& value, std::string_view doc) override {
    Line(key, '"' + value + '"', doc);
  }
  void Value(std::string_view key, std::vector<std::string>& value, std::string_view doc) override {
    Line(key, json(value).dump(), doc);
  }
  void Value(std::string_view key, std::vector<double>& value, std::string_view doc) override {
    Line(key, json(value).dump(), doc);
  }

 protected:
  void ChoiceIndex(std::string_view key, int& index, std::span<const std::string_view> names,
                   std::string_view doc) override {
    Line(key, fmt::format("{} ({})", names[static_cast<size_t>(index)], JoinNames(names)), doc);
  }

 private:
  void Line(std::string_view key, std::string_view value, std::string_view doc) {
    text += fmt::format("  {} = {}\n      {}\n", Path(key), value, doc);
  }
};

}  // namespace

std::string NearestWord(std::string_view word, std::span<const std::string> known) {
  const auto nearest = std::min_element(known.begin(), known.end(), [&](auto& a, auto& b) {
    return EditDistance(word, a) < EditDistance(word, b);
  });
  return nearest == known.end() ? std::string() : *nearest;
}

namespace internal {

json OptionsToJson(OptionsRef options) {
  JsonWriter writer;
  options.Visit(writer);
  return std::move(writer.root);
}

void OptionsFromJson(const json& json, OptionsRef options, std::string_view source) {
  JsonReader reader(json, source);
  options.Visit(reader);
  reader.Finish();
  BoundsChecker checker(source);
  options.Visit(checker);
}

void SetOption(std::string_view assignment, OptionsRef options) {
  const size_t equals = assignment.find('=');
  if (equals == std::string_view::npos || equals == 0) {
    throw UsageError(fmt::format("--set {}: expected key.path=value", assignment));
  }
  const std::string text(assignment.substr(equals + 1));
  json value = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (value.is_discarded()) value = text;
  std::string_view path = assignment.substr(0, equals);
  while (!path.empty()) {
    const size_t dot = path.rfind('.');
    const std::string key(path.substr(dot == std::string_view::npos ? 0 : dot + 1));
    value = json{{key, std::move(value)}};
    path = dot == std::string_view::npos ? std::string_view() : path.substr(0, dot);
  }
  OptionsFromJson(value, options, fmt::format("--set {}", assignment));
}

void CheckOptions(OptionsRef options) {
  BoundsChecker checker("options");
  options.Visit(checker);
}

std::string DescribeOptions(OptionsRef options) {
  Describer describer;
  options.Visit(describer);
  return std::move(describer.text);
}

}  // namespace internal
}  // namespace s3lam
