#include <array>
#include <nlohmann/json.hpp>
#include <string>

#include "json_fields.h"
#include "s3lam/base/error.h"
#include "s3lam/base/options_json.h"
#include "s3lam/io/file.h"
#include "s3lam/io/image_sequence.h"

namespace s3lam {
namespace {

void CheckKeys(const nlohmann::json& json, const std::string& source) {
  static const std::array<std::string, 6> kKeys = {"model",  "width", "height",
                                                   "params", "fps",   "comment"};
  for (const auto& [key, value] : json.items()) {
    if (std::find(kKeys.begin(), kKeys.end(), key) == kKeys.end()) {
      ThrowInputError("{}: unknown key '{}'; did you mean '{}'?", source, key,
                      NearestWord(key, kKeys));
    }
  }
}

CameraModel ModelByName(const std::string& name, const std::string& source) {
  const auto model = CameraModelFromName(name);
  if (!model) {
    ThrowInputError("{}: 'model' {} is not a supported COLMAP camera model ({})", source, name,
                    SupportedCameraModels());
  }
  return *model;
}

}  // namespace

CameraFile ReadCameraJson(const std::filesystem::path& path) {
  const std::string source = path.string();
  const nlohmann::json json = ReadJson(path);
  const JsonFields fields(json, source);
  CheckKeys(json, source);
  CameraFile file;
  Camera& camera = file.camera;
  camera.id = CameraId(1);
  camera.model = ModelByName(fields.String("model"), source);
  camera.width = fields.Int("width");
  camera.height = fields.Int("height");
  for (const nlohmann::json& param : fields.List("params")) {
    camera.params.push_back(fields.AsNumber(param, "params"));
  }
  camera.Check(source);
  if (fields.Has("fps")) {
    file.fps = fields.Number("fps");
    if (!(*file.fps > 0.0)) ThrowInputError("{}: 'fps' must be positive", source);
  }
  return file;
}

void WriteCameraJson(const CameraFile& file, const std::filesystem::path& path) {
  nlohmann::json json = {{"model", CameraModelName(file.camera.model)},
                         {"width", file.camera.width},
                         {"height", file.camera.height},
                         {"params", file.camera.params}};
  if (file.fps) json["fps"] = *file.fps;
  WriteJson(path, json);
}

}  // namespace s3lam
