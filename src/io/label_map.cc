#include "s3lam/io/label_map.h"

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string_view>
#include <vector>

#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

template <typename Integer>
Integer ParseWhole(std::string_view text, const std::string& where) {
  Integer value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    ThrowInputError("{}: '{}' is not an integer", where, text);
  }
  return value;
}

LabelMap::Classes ParseClasses(const nlohmann::json& table, const std::string& where) {
  if (!table.is_object()) {
    ThrowInputError("{}: a label map is an object {{\"label\": class id or null}}", where);
  }
  if (table.empty()) ThrowInputError("{}: the label map is empty", where);
  LabelMap::Classes classes;
  for (const auto& [key, value] : table.items()) {
    const auto label = ParseWhole<int64_t>(key, where);
    if (value.is_null()) {
      classes[label] = std::nullopt;
    } else if (value.is_number_integer() && value == value.get<int>()) {
      classes[label] = value.get<int>();
    } else {
      ThrowInputError("{}: label {}: {} is neither a class id nor null", where, key, value.dump());
    }
  }
  return classes;
}

void ParseJsonMap(const std::filesystem::path& path, LabelMap& map) {
  const nlohmann::json document = ReadJson(path);
  const bool has_things = document.is_object() && document.contains("things");
  const bool has_stuff = document.is_object() && document.contains("stuff");
  if (!has_things && !has_stuff) {
    map.class_of_label = ParseClasses(document, path.string());
    return;
  }
  if (!has_things || !has_stuff || document.size() != 2) {
    ThrowInputError("{}: where stuff is numbered apart, 'things' and 'stuff' are due and no more",
                    path.string());
  }
  map.class_of_label = ParseClasses(document["things"], path.string() + ": things");
  map.class_of_stuff = ParseClasses(document["stuff"], path.string() + ": stuff");
}

std::vector<std::string> SplitAtTabs(std::string line) {
  if (!line.empty() && line.back() == '\r') line.pop_back();
  std::vector<std::string> fields;
  if (line.empty()) return fields;
  size_t begin = 0;
  for (size_t end = 0; end != std::string::npos; begin = end + 1) {
    end = line.find('\t', begin);
    fields.push_back(line.substr(begin, end - begin));
  }
  return fields;
}

void ParseTsvMap(const std::filesystem::path& path, LabelMap& map) {
  std::istringstream stream(ReadFile(path));
  std::string line;
  std::getline(stream, line);
  const std::vector<std::string> header = SplitAtTabs(line);
  const auto label_at = std::find(header.begin(), header.end(), "id") - header.begin();
  const auto class_at = std::find(header.begin(), header.end(), "nyu40id") - header.begin();
  const auto columns = static_cast<std::ptrdiff_t>(header.size());
  if (label_at == columns || class_at == columns) {
    ThrowInputError("{}: the first line names no columns 'id' and 'nyu40id'", path.string());
  }
  for (size_t number = 2; std::getline(stream, line); ++number) {
    const std::vector<std::string> fields = SplitAtTabs(line);
    if (fields.empty()) continue;
    const std::string where = fmt::format("{}:{}", path.string(), number);
    if (static_cast<std::ptrdiff_t>(fields.size()) <= std::max(label_at, class_at)) {
      ThrowInputError("{}: only {} columns", where, fields.size());
    }
    const auto label = ParseWhole<int64_t>(fields[static_cast<size_t>(label_at)], where);
    const std::string& text = fields[static_cast<size_t>(class_at)];
    const int class_id = text.empty() ? 0 : ParseWhole<int>(text, where);
    map.class_of_label[label] = class_id == 0 ? std::nullopt : std::optional(class_id);
  }
  map.class_of_label.emplace(0, std::nullopt);
}

}  // namespace

LabelMap ReadLabelMap(const std::filesystem::path& path) {
  LabelMap map{path.string(), {}};
  if (path.extension() == ".tsv") {
    ParseTsvMap(path, map);
  } else {
    ParseJsonMap(path, map);
  }
  return map;
}

}  // namespace s3lam
