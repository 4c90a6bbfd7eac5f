#include "s3lam/io/constraints.h"

#include <charconv>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <sstream>

#include "json_fields.h"
#include "line_parser.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

using internal::LineParser;
using internal::LineReader;
using nlohmann::json;

constexpr size_t kNumbersOfPrior = 9;  // Position, rotation and two sigmas.
constexpr double kSameTime = 1e-3;     // [s]
constexpr double kNormTolerance = 1e-2;
constexpr double kRadians = std::numbers::pi / 180.0;

std::map<std::string, ImageId, std::less<>> ImagesByName(const Reconstruction& model) {
  std::map<std::string, ImageId, std::less<>> by_name;
  for (const auto& [id, image] : model.images) by_name[image.name] = id;
  return by_name;
}

bool IsAll(const json& value) { return value.is_string() && value.get<std::string>() == "all"; }

void ReadConstantImages(const JsonFields& fields, const Reconstruction& model,
                        Constraints& constraints) {
  if (IsAll(fields.At("images"))) {
    for (const auto& [id, image] : model.images) constraints.constant_images.insert(id);
    return;
  }
  const auto by_name = ImagesByName(model);
  for (const json& entry : fields.List("images")) {
    const auto it = entry.is_string() ? by_name.find(entry.get<std::string>()) : by_name.end();
    if (it == by_name.end()) {
      ThrowInputError("{}: images: the model has no image {}", fields.where(), entry.dump());
    }
    constraints.constant_images.insert(it->second);
  }
}

void ReadConstantPoints(const JsonFields& fields, const Reconstruction& model,
                        Constraints& constraints) {
  if (IsAll(fields.At("points"))) {
    for (const auto& [id, point] : model.points) constraints.constant_points.insert(id);
    return;
  }
  for (const json& entry : fields.List("points")) {
    const PointId id(fields.AsInteger<uint64_t>(entry, "points"));
    if (!model.points.contains(id)) {
      ThrowInputError("{}: points: the model has no point {}", fields.where(), id.value());
    }
    constraints.constant_points.insert(id);
  }
}

void ReadPlaneDistances(const JsonFields& fields, Constraints& constraints) {
  for (const json& entry : fields.List("plane_distances")) {
    const JsonFields of_pair(entry, fields.where() + ": plane_distances");
    const json& planes = of_pair.List("planes");
    if (planes.size() != 2) ThrowInputError("{}: 'planes' needs two ids", of_pair.where());
    PlaneDistance known;
    known.a = PlaneId(of_pair.AsInteger<uint32_t>(planes[0], "planes"));
    known.b = PlaneId(of_pair.AsInteger<uint32_t>(planes[1], "planes"));
    known.distance = of_pair.Number("distance");
    known.sigma = of_pair.Number("sigma");
    if (known.a == known.b || known.distance <= 0.0 || known.sigma <= 0.0) {
      ThrowInputError("{}: planes {} and {}: two planes, a distance and a sigma above 0 are needed",
                      of_pair.where(), known.a.value(), known.b.value());
    }
    constraints.plane_distances.push_back(known);
  }
}

ImageId FindImage(std::string_view word, const std::map<std::string, ImageId, std::less<>>& by_name,
                  const Reconstruction& model, const std::vector<double>& times,
                  const LineParser& parser) {
  if (const auto it = by_name.find(word); it != by_name.end()) return it->second;
  double time = 0.0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), time);
  if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(time)) {
    parser.Fail("'{}' is neither a time nor an image of the model", word);
  }
  if (times.empty()) parser.Fail("a time, but no keyframes.txt tells the times of the images");
  auto image = model.images.begin();
  for (const double image_time : times) {
    if (std::abs(image_time - time) <= kSameTime) return image->first;
    ++image;
  }
  parser.Fail("no image of the model was taken at {} s", time);
}

PosePrior ParsePrior(ImageId image_id, LineParser& parser) {
  PosePrior prior;
  prior.image_id = image_id;
  Rigid3 world_from_camera;
  for (double& coordinate : world_from_camera.translation) coordinate = parser.Real("translation");
  for (double& coefficient : world_from_camera.rotation.coeffs()) {
    coefficient = parser.Real("quaternion");
  }
  prior.sigma_position = parser.Real("sigma_position");
  prior.sigma_rotation = kRadians * parser.Real("sigma_rotation");
  if (std::abs(world_from_camera.rotation.norm() - 1.0) > kNormTolerance) {
    parser.Fail("the quaternion's norm is {}, not 1", world_from_camera.rotation.norm());
  }
  if (prior.sigma_position < 0.0 || prior.sigma_rotation < 0.0) parser.Fail("a negative sigma");
  if (prior.sigma_position == 0.0 && prior.sigma_rotation == 0.0) {
    parser.Fail("neither position nor rotation is known: both sigmas are 0");
  }
  world_from_camera.rotation.normalize();
  prior.cam_from_world = world_from_camera.Inverse();
  return prior;
}

}  // namespace

void ReadConstantParts(const std::filesystem::path& path, const Reconstruction& model,
                       Constraints& constraints) {
  const json document = ReadJson(path);
  const JsonFields fields(document, path.string());
  for (const auto& [key, value] : document.items()) {
    if (key != "images" && key != "points" && key != "plane_distances") {
      ThrowInputError("{}: unknown key '{}': there are 'images', 'points' and 'plane_distances'",
                      fields.where(), key);
    }
  }
  if (fields.Has("images")) ReadConstantImages(fields, model, constraints);
  if (fields.Has("points")) ReadConstantPoints(fields, model, constraints);
  if (fields.Has("plane_distances")) ReadPlaneDistances(fields, constraints);
}

void ReadPosePriors(std::istream& stream, const std::string& source, const Reconstruction& model,
                    const std::vector<double>& image_times_s, Constraints& constraints) {
  LineReader reader(stream, source);
  const auto by_name = ImagesByName(model);
  std::map<ImageId, PosePrior> priors;
  while (reader.NextData()) {
    LineParser parser = reader.Parser();
    const std::string word(parser.AllBut(kNumbersOfPrior, "time or image"));
    const ImageId id = FindImage(word, by_name, model, image_times_s, parser);
    if (!priors.emplace(id, ParsePrior(id, parser)).second) {
      parser.Fail("a second prior for the image {}", model.images.at(id).name);
    }
  }
  if (priors.empty()) ThrowInputError("{}: no pose priors", source);
  for (const auto& [id, prior] : priors) constraints.pose_priors.push_back(prior);
}

void ReadPosePriors(const std::filesystem::path& path, const Reconstruction& model,
                    const std::vector<double>& image_times_s, Constraints& constraints) {
  std::istringstream stream(ReadFile(path));
  ReadPosePriors(stream, path.string(), model, image_times_s, constraints);
}

}  // namespace s3lam
