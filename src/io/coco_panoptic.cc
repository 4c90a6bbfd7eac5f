#include "coco_panoptic.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

using nlohmann::json;

constexpr uint32_t kMaxSegmentId = (1U << 24U) - 1;  // Three bytes of colour.
/// The kind is of the category: isthing is in the list of those.
constexpr SegmentRules kRules = {1, kMaxSegmentId, false};

CocoAnnotation ParseAnnotation(const json& annotation, const ClassResolver& classes,
                               const std::string& where) {
  CocoAnnotation result;
  try {
    const auto infos = annotation.find("segments_info");
    if (infos == annotation.end() || !infos->is_array()) {
      ThrowInputError("{}: 'segments_info' is missing or not a list", where);
    }
    result.table = ParseSegments(*infos, classes, kRules, where);
  } catch (const InputError& error) {
    result.defect = error.what();
  }
  return result;
}

}  // namespace

std::map<std::string, CocoAnnotation> ReadCocoAnnotations(const std::filesystem::path& path,
                                                          const ClassResolver& classes) {
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
        ParseAnnotation(annotation, classes, fmt::format("{}: {}", path.string(), file));
    const auto [it, inserted] = result.emplace(file, std::move(parsed));
    if (!inserted) it->second.defect = fmt::format("{}: {} is listed twice", path.string(), file);
  }
  return result;
}

}  // namespace s3lam
