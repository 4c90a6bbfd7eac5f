#include "coco_panoptic.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

using nlohmann::json;

constexpr int64_t kMaxSegmentId = (1 << 24) - 1;  // Three bytes of colour.

int64_t RequireInteger(const json& object, const char* key, const std::string& where) {
  const auto it = object.find(key);
  if (it == object.end() || !it->is_number_integer()) {
    ThrowInputError("{}: '{}' is missing or not an integer", where, key);
  }
  return it->get<int64_t>();
}

double ReadScore(const json& info, const std::string& where) {
  const auto it = info.find("score");
  if (it == info.end()) return 1.0;
  const double score = it->is_number() ? it->get<double>() : std::nan("");
  if (!(score >= 0.0 && score <= 1.0)) {
    ThrowInputError("{}: score {} is not in [0, 1]", where, it->dump());
  }
  return score;
}

std::pair<uint32_t, PanopticSegment> ParseSegment(const json& info, const ClassTable& class_table,
                                                  const std::string& where) {
  if (!info.is_object()) ThrowInputError("{}: entry of segments_info is not an object", where);
  const int64_t id = RequireInteger(info, "id", where + ": segment");
  const std::string name = fmt::format("{}: segment {}", where, id);
  if (id <= 0 || id > kMaxSegmentId) ThrowInputError("{}: id is not in [1, 2^24)", name);
  const int64_t category = RequireInteger(info, "category_id", name);
  const std::optional<int> class_index = category == static_cast<int>(category)
                                             ? class_table.IndexOfId(static_cast<int>(category))
                                             : std::nullopt;
  if (!class_index) {
    ThrowInputError("{}: class {} is not in the class table '{}'", name, category,
                    class_table.name);
  }
  PanopticSegment segment;
  segment.class_index = *class_index;
  segment.score = ReadScore(info, name);
  if (info.contains("iscrowd")) segment.is_crowd = RequireInteger(info, "iscrowd", name) != 0;
  return {static_cast<uint32_t>(id), segment};
}

CocoAnnotation ParseAnnotation(const json& annotation, const ClassTable& class_table,
                               const std::string& where) {
  CocoAnnotation result;
  try {
    const auto infos = annotation.find("segments_info");
    if (infos == annotation.end() || !infos->is_array()) {
      ThrowInputError("{}: 'segments_info' is missing or not a list", where);
    }
    for (const json& info : *infos) {
      const auto [id, segment] = ParseSegment(info, class_table, where);
      if (!result.segments.emplace(id, segment).second) {
        ThrowInputError("{}: segment {} is listed twice", where, id);
      }
    }
  } catch (const InputError& error) {
    result.defect = error.what();
  }
  return result;
}

}  // namespace

std::map<std::string, CocoAnnotation> ReadCocoAnnotations(const std::filesystem::path& path,
                                                          const ClassTable& class_table) {
  const json document = ReadJson(path);
  const auto list = document.is_object() ? document.find("annotations") : document.end();
  if (list == document.end() || !list->is_array()) {
    ThrowInputError("{}: not a COCO panoptic file: no list 'annotations'", path.string());
  }
  std::map<std::string, CocoAnnotation> result;
  for (size_t i = 0; i < list->size(); ++i) {
    const json& annotation = (*list)[i];
    const auto name = annotation.is_object() ? annotation.find("file_name") : annotation.end();
    if (name == annotation.end() || !name->is_string()) {
      ThrowInputError("{}: annotations[{}] has no 'file_name'", path.string(), i);
    }
    const std::string file = name->get<std::string>();
    CocoAnnotation parsed =
        ParseAnnotation(annotation, class_table, fmt::format("{}: {}", path.string(), file));
    const auto [it, inserted] = result.emplace(file, std::move(parsed));
    if (!inserted) it->second.defect = fmt::format("{}: {} is listed twice", path.string(), file);
  }
  return result;
}

}  // namespace s3lam
