#include "s3lam/eval/model_difference.h"

#include <fmt/format.h>

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

namespace s3lam {
namespace {

std::map<std::string, const Image*> ImagesByName(const Reconstruction& model) {
  std::map<std::string, const Image*> images;
  for (const auto& [id, image] : model.images) images.emplace(image.name, &image);
  return images;
}

double FocalPercent(const Camera& camera, const Camera& other) {
  return 100.0 * std::abs(camera.params.at(0) / other.params.at(0) - 1.0);
}

ErrorStatistics PointDistances(const Reconstruction& model, const Reconstruction& other,
                               const Similarity3& other_from_model) {
  std::vector<double> distances;
  for (const auto& [id, point] : model.points) {
    const auto same = other.points.find(id);
    if (same == other.points.end()) continue;
    distances.push_back((other_from_model * point.xyz - same->second.xyz).norm());
  }
  return ComputeErrorStatistics(std::move(distances));
}

}  // namespace

std::optional<ModelDifference> CompareModels(const Reconstruction& model,
                                             const Reconstruction& other,
                                             TrajectoryAlignment align) {
  ModelDifference difference;
  difference.num_images = model.images.size();
  difference.num_other_images = other.images.size();
  const auto other_images = ImagesByName(other);
  Trajectory poses;
  Trajectory other_poses;
  std::vector<double> focal;
  for (const auto& [name, image] : ImagesByName(model)) {
    const auto same = other_images.find(name);
    if (same == other_images.end()) continue;
    const auto place = static_cast<double>(difference.names.size());
    poses.push_back({place, image->cam_from_world.Inverse()});
    other_poses.push_back({place, same->second->cam_from_world.Inverse()});
    focal.push_back(FocalPercent(model.CameraOf(*image), other.CameraOf(*same->second)));
    difference.names.push_back(name);
  }
  TrajectoryErrorOptions options;
  options.align = align;
  options.max_dt_s = 0.0;
  auto errors = CompareTrajectories(poses, other_poses, options);
  if (!errors) return std::nullopt;
  difference.other_from_model = errors->truth_from_estimate;
  difference.poses = std::move(errors->poses);
  difference.center = errors->ate_translation;
  difference.rotation_deg = errors->ate_rotation_deg;
  difference.focal_percent = ComputeErrorStatistics(std::move(focal));
  difference.points = PointDistances(model, other, difference.other_from_model);
  return difference;
}

nlohmann::json ToJson(const ModelDifference& difference) {
  return {{"images", difference.num_images},
          {"other_images", difference.num_other_images},
          {"common_images", difference.names.size()},
          {"other_from_model", ToJson(difference.other_from_model)},
          {"center", ToJson(difference.center)},
          {"rotation_deg", ToJson(difference.rotation_deg)},
          {"focal_percent", ToJson(difference.focal_percent)},
          {"points", ToJson(difference.points)}};
}

std::string ToTable(const ModelDifference& difference) {
  std::string table = fmt::format(
      "images                {} and {}, {} in both\nalignment             scale {:.6g}\n\n",
      difference.num_images, difference.num_other_images, difference.names.size(),
      difference.other_from_model.scale);
  table += TableHeader();
  table += TableRow("camera centres", difference.center);
  table += TableRow("rotations [deg]", difference.rotation_deg);
  table += TableRow("focal lengths [%]", difference.focal_percent);
  if (difference.points.count > 0) table += TableRow("points of same id", difference.points);
  return table;
}

}  // namespace s3lam
