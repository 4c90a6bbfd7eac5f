#include "class_table_json.h"

#include <algorithm>
#include <array>

#include "json_fields.h"
#include "s3lam/base/options_json.h"
#include "s3lam/io/file.h"
#include "s3lam/io/semantic_map_io.h"

namespace s3lam {
namespace {

using nlohmann::json;

constexpr std::array<std::string_view, 3> kOrientationNames = {"any", "horizontal", "vertical"};
const std::array<std::string, 8> kClassKeys = {
    "id", "name", "thing", "planar", "dynamic", "min_plane_inliers", "orientation", "color"};

void CheckKeys(const json& object, const std::string& where) {
  for (const auto& [key, value] : object.items()) {
    if (std::find(kClassKeys.begin(), kClassKeys.end(), key) == kClassKeys.end()) {
      ThrowInputError("{}: unknown key '{}', did you mean '{}'?", where, key,
                      NearestWord(key, kClassKeys));
    }
  }
}

SurfaceOrientation ParseOrientation(const JsonFields& fields) {
  const std::string name = fields.String("orientation");
  const auto it = std::find(kOrientationNames.begin(), kOrientationNames.end(), name);
  if (it == kOrientationNames.end()) {
    ThrowInputError("{}: orientation '{}' is not any, horizontal or vertical", fields.where(),
                    name);
  }
  return static_cast<SurfaceOrientation>(it - kOrientationNames.begin());
}

Rgb ParseColor(const JsonFields& fields) {
  const Eigen::Vector3d values = fields.Vector<3>("color");
  Rgb color;
  for (int i = 0; i < 3; ++i) {
    if (values[i] < 0.0 || values[i] > 255.0 || values[i] != std::floor(values[i])) {
      ThrowInputError("{}: 'color' needs three integers in 0..255", fields.where());
    }
    color[static_cast<size_t>(i)] = static_cast<uint8_t>(values[i]);
  }
  return color;
}

SemanticClass ParseClass(const json& object, const std::string& where) {
  const JsonFields fields(object, where);
  CheckKeys(object, where);
  SemanticClass result;
  result.id = fields.Int("id");
  result.name = fields.String("name");
  result.is_thing = fields.Bool("thing");
  result.is_planar = fields.Bool("planar");
  result.is_dynamic = fields.Bool("dynamic");
  if (fields.Has("min_plane_inliers")) {
    result.min_plane_inliers = fields.Int("min_plane_inliers");
    if (result.min_plane_inliers < 3) {
      ThrowInputError("{}: 'min_plane_inliers' is below 3", where);
    }
  }
  if (fields.Has("orientation")) result.orientation = ParseOrientation(fields);
  result.color = ParseColor(fields);
  return result;
}

}  // namespace

json ClassTableToJson(const ClassTable& table) {
  json classes = json::array();
  for (const SemanticClass& c : table.classes) {
    classes.push_back({{"id", c.id},
                       {"name", c.name},
                       {"thing", c.is_thing},
                       {"planar", c.is_planar},
                       {"dynamic", c.is_dynamic},
                       {"min_plane_inliers", c.min_plane_inliers},
                       {"orientation", kOrientationNames[static_cast<size_t>(c.orientation)]},
                       {"color", c.color}});
  }
  return {{"name", table.name}, {"classes", std::move(classes)}};
}

ClassTable ClassTableFromJson(const json& document, const std::string& where) {
  const JsonFields fields(document, where);
  ClassTable table;
  table.name = fields.String("name");
  const json& list = fields.List("classes");
  for (size_t i = 0; i < list.size(); ++i) {
    table.classes.push_back(ParseClass(list[i], fmt::format("{}: classes[{}]", where, i)));
  }
  if (table.classes.empty()) ThrowInputError("{}: the class table is empty", where);
  const auto by_id = [](const SemanticClass& a, const SemanticClass& b) { return a.id < b.id; };
  std::stable_sort(table.classes.begin(), table.classes.end(), by_id);
  for (size_t i = 1; i < table.classes.size(); ++i) {
    if (table.classes[i - 1].id == table.classes[i].id) {
      ThrowInputError("{}: class id {} is there twice", where, table.classes[i].id);
    }
  }
  return table;
}

ClassTable ReadClassTable(const std::filesystem::path& path) {
  return ClassTableFromJson(ReadJson(path), path.string());
}

}  // namespace s3lam
