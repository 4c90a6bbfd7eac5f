#include "s3lam/semantics/visibility.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <set>

namespace s3lam {
namespace {

constexpr double kMaxAxisAngle = std::numbers::pi / 4.0;

/// Where an image was taken, and how far away what it shows is.
struct Viewpoint {
  const Image* image = nullptr;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double median_depth = 0.0;
};

double MedianPointDepth(const Reconstruction& reconstruction, const Image& image) {
  std::vector<double> depths;
  for (const Point2D& keypoint : image.points2D) {
    if (!keypoint.point_id.valid()) continue;
    const Eigen::Vector3d& x = reconstruction.points.at(keypoint.point_id).xyz;
    depths.push_back((image.cam_from_world * x).z());
  }
  if (depths.empty()) return 0.0;
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return *middle;
}

/// The viewpoints nearest to `from` that look the same way, nearest first.
std::vector<const Image*> FindNeighbors(const std::vector<Viewpoint>& viewpoints,
                                        const Viewpoint& from, const VisibilityOptions& options) {
  const double max_angle = options.max_view_angle_deg * std::numbers::pi / 180.0;
  std::vector<std::pair<double, const Image*>> found;
  for (const Viewpoint& other : viewpoints) {
    if (other.image == from.image) continue;
    const double distance = (other.center - from.center).norm();
    // Twice the angle, since what matters is each point's own depth.
    const double depth = from.median_depth > 0.0 ? from.median_depth : other.median_depth;
    const double max_distance = 2.0 * std::tan(max_angle) * depth;
    if (distance > max_distance || other.axis.dot(from.axis) < std::cos(kMaxAxisAngle)) continue;
    found.emplace_back(distance, other.image);
  }
  std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first < b.first : a.second->id < b.second->id;
  });
  std::vector<const Image*> neighbors;
  for (const auto& [distance, image] : found) {
    if (neighbors.size() >= static_cast<size_t>(options.max_neighbors)) break;
    neighbors.push_back(image);
  }
  return neighbors;
}

}  // namespace

void VisibilityOptions::Visit(OptionVisitor& v) {
  v.Value(
      "predict", predict,
      "Also look up points that an image does not observe but must show, because one taken from "
      "nearly the same place observes them.");
  v.Value("max_view_angle_deg", max_view_angle_deg,
          "Largest angle between the rays of the two images to the point [deg].", 0.0, 60.0);
  v.Value("max_depth_ratio", max_depth_ratio, "Largest ratio of its depths in the two.", 1.0);
  v.Value("max_neighbors", max_neighbors, "Nearest images that are asked.", 0);
}

VisibilityPredictor::VisibilityPredictor(const Reconstruction& reconstruction,
                                         const VisibilityOptions& options)
    : reconstruction_(reconstruction), options_(options) {
  if (!options.predict) return;
  std::vector<Viewpoint> viewpoints;
  for (const auto& [id, image] : reconstruction.images) {
    viewpoints.push_back({&image, image.cam_from_world.CenterInB(),
                          image.cam_from_world.rotation.conjugate() * Eigen::Vector3d::UnitZ(),
                          MedianPointDepth(reconstruction, image)});
  }
  for (const Viewpoint& viewpoint : viewpoints) {
    neighbors_[viewpoint.image->id] = FindNeighbors(viewpoints, viewpoint, options);
  }
}

std::vector<VisibilityPredictor::Prediction> VisibilityPredictor::Predict(
    const Image& image) const {
  std::vector<Prediction> predictions;
  const auto it = neighbors_.find(image.id);
  if (it == neighbors_.end()) return predictions;
  const Camera& camera = reconstruction_.CameraOf(image);
  const Eigen::Vector3d center = image.cam_from_world.CenterInB();
  const double min_cosine = std::cos(options_.max_view_angle_deg * std::numbers::pi / 180.0);
  std::set<PointId> done;
  for (const Point2D& keypoint : image.points2D) done.insert(keypoint.point_id);
  for (const Image* neighbor : it->second) {
    const Eigen::Vector3d other_center = neighbor->cam_from_world.CenterInB();
    for (const Point2D& keypoint : neighbor->points2D) {
      if (!keypoint.point_id.valid() || done.contains(keypoint.point_id)) continue;
      const Eigen::Vector3d& x = reconstruction_.points.at(keypoint.point_id).xyz;
      const Eigen::Vector3d ray = x - center;
      const Eigen::Vector3d other_ray = x - other_center;
      const double ratio = ray.norm() / other_ray.norm();
      if (!(ray.dot(other_ray) >= min_cosine * ray.norm() * other_ray.norm()) ||
          std::max(ratio, 1.0 / ratio) > options_.max_depth_ratio) {
        continue;
      }
      const auto xy = camera.ImageFromCamera(image.cam_from_world * x);
      if (!xy || xy->x() < 0.0 || xy->y() < 0.0 || xy->x() >= camera.width ||
          xy->y() >= camera.height) {
        continue;
      }
      done.insert(keypoint.point_id);
      predictions.push_back({keypoint.point_id, *xy});
    }
  }
  std::sort(predictions.begin(), predictions.end(),
            [](const auto& a, const auto& b) { return a.point_id < b.point_id; });
  return predictions;
}

}  // namespace s3lam
