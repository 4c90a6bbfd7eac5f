#include "synthetic_semantics.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include "s3lam/base/rng.h"

namespace s3lam::synthetic {
namespace {

constexpr uint64_t kLabelStream = 101;
constexpr float kLabelConfidence = 0.97F;

using Labels = std::map<PointId, int>;  // SceneObject::id.

// The labels as lifting would have them. Each planar object of n points is given wrong_fraction * n
// points of others; as it loses about as many, that is the share of wrong points in its cluster.
Labels MakeLabels(const Scene& scene, uint64_t seed, double wrong_fraction,
                  const SyntheticMap& map) {
  Labels labels = map.object_of_point;
  std::vector<PointId> pool;
  std::map<int, size_t> num_points;
  for (const auto& [id, object] : labels) {
    pool.push_back(id);
    ++num_points[object];
  }
  Rng rng = Rng(seed).Fork(kLabelStream);
  std::vector<size_t> order = rng.Sample(pool.size(), pool.size());
  for (const auto& [object, count] : num_points) {
    if (!scene.objects[static_cast<size_t>(object - 1)].plane_in_world) continue;
    auto wanted = static_cast<size_t>(std::lround(wrong_fraction * static_cast<double>(count)));
    std::vector<size_t> left;
    for (const size_t index : order) {
      if (wanted > 0 && map.object_of_point.at(pool[index]) != object) {
        labels[pool[index]] = object;
        --wanted;
      } else {
        left.push_back(index);
      }
    }
    order = std::move(left);
  }
  return labels;
}

void AddDistributions(const Scene& scene, const Labels& labels, SyntheticMap& map) {
  SemanticMap& semantics = map.semantics;
  const int num_classes = scene.class_table.size();
  semantics.distributions.resize(static_cast<Eigen::Index>(labels.size()), num_classes);
  const float rest =
      num_classes > 1 ? (1.0F - kLabelConfidence) / static_cast<float>(num_classes - 1) : 0.0F;
  semantics.distributions.setConstant(rest);
  Eigen::Index row = 0;
  for (const auto& [id, label] : labels) {
    const int class_id = scene.objects[static_cast<size_t>(label - 1)].class_id;
    semantics.distributions(row++, *scene.class_table.IndexOfId(class_id)) = kLabelConfidence;
    semantics.points.push_back(id);
    semantics.num_mask_observations.push_back(
        static_cast<int>(map.truth.points.at(id).track.size()));
  }
}

void AddClusters(const Scene& scene, const Labels& labels, SyntheticMap& map) {
  std::map<int, std::vector<PointId>> points_of_object;
  for (const auto& [id, label] : labels) points_of_object[label].push_back(id);
  std::map<int, ClusterId> cluster_of_object;
  for (const auto& [object_id, points] : points_of_object) {
    Cluster cluster;
    cluster.id = ClusterId(static_cast<uint32_t>(map.semantics.clusters.size() + 1));
    const SceneObject& object = scene.objects[static_cast<size_t>(object_id - 1)];
    cluster.class_index = *scene.class_table.IndexOfId(object.class_id);
    cluster.points = points;
    for (const PointId id : points) {
      cluster.centroid_in_world += map.estimate.points.at(id).xyz;
    }
    cluster.centroid_in_world /= static_cast<double>(points.size());
    cluster_of_object[object_id] = cluster.id;
    map.object_of_cluster[cluster.id] = object_id;
    map.semantics.clusters.emplace(cluster.id, std::move(cluster));
  }
  for (const auto& [id, label] : labels) {
    map.semantics.cluster_of_point.push_back(cluster_of_object.at(label));
  }
}

// Convex outline of 2D points, counter-clockwise (Andrew's monotone chain).
std::vector<Eigen::Vector2d> ConvexOutline(std::vector<Eigen::Vector2d> points) {
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  });
  std::vector<Eigen::Vector2d> outline;
  const auto turns_right = [&](const Eigen::Vector2d& next) {
    const Eigen::Vector2d a = outline.back() - outline[outline.size() - 2];
    const Eigen::Vector2d b = next - outline.back();
    return a.x() * b.y() - a.y() * b.x() <= 0.0;
  };
  for (int pass = 0; pass < 2; ++pass) {
    const size_t start = outline.size();
    for (const Eigen::Vector2d& point : points) {
      while (outline.size() >= start + 2 && turns_right(point)) outline.pop_back();
      outline.push_back(point);
    }
    outline.pop_back();
    std::reverse(points.begin(), points.end());
  }
  return outline;
}

// Fits the plane to the points that truly lie on it, as a robust estimator would end up doing.
void AddPlane(const Plane& true_plane, const Cluster& cluster, const Eigen::Vector3d& viewpoint,
              SyntheticMap& map) {
  PlanarSurface surface;
  std::vector<Eigen::Vector3d> true_points;
  for (const PointId id : cluster.points) {
    const bool is_own = map.object_of_point.at(id) == map.object_of_cluster.at(cluster.id);
    const bool on_plane = is_own && map.on_plane.at(id);
    if (on_plane) true_points.push_back(map.estimate.points.at(id).xyz);
    if (on_plane || !is_own) surface.inliers.push_back(id);
  }
  const int min_inliers =
      map.semantics.class_table.classes[static_cast<size_t>(cluster.class_index)].min_plane_inliers;
  if (true_points.size() < static_cast<size_t>(std::max(min_inliers, 8))) return;
  surface.id = PlaneId(static_cast<uint32_t>(map.semantics.planes.size() + 1));
  surface.cluster_id = cluster.id;
  surface.class_index = cluster.class_index;
  surface.plane_in_world = FitPlaneToPoints(true_points, viewpoint);
  for (const Eigen::Vector3d& point : true_points) surface.centroid_in_world += point;
  surface.centroid_in_world /= static_cast<double>(true_points.size());
  std::tie(surface.axis_u_in_world, surface.axis_v_in_world) =
      PlaneAxes(surface.plane_in_world.normal);
  double sum = 0.0;
  for (const Eigen::Vector3d& point : true_points) {
    const Eigen::Vector3d offset = point - surface.centroid_in_world;
    surface.extent.emplace_back(surface.axis_u_in_world.dot(offset),
                                surface.axis_v_in_world.dot(offset));
    sum += std::pow(surface.plane_in_world.SignedDistance(point), 2);
  }
  surface.extent = ConvexOutline(std::move(surface.extent));
  surface.rms = std::sqrt(sum / static_cast<double>(true_points.size()));
  map.true_planes[surface.id] = true_plane;
  map.semantics.planes.emplace(surface.id, std::move(surface));
}

}  // namespace

void AddSemantics(const Scene& scene, uint64_t seed, const SyntheticMapOptions& options,
                  SyntheticMap& map) {
  map.semantics.class_table = scene.class_table;
  map.semantics.model_fingerprint = FingerprintOfModel(map.estimate);
  const Labels labels = MakeLabels(scene, seed, options.wrong_label_fraction, map);
  AddDistributions(scene, labels, map);
  AddClusters(scene, labels, map);
  Eigen::Vector3d viewpoint = Eigen::Vector3d::Zero();
  for (const auto& [id, image] : map.estimate.images) {
    viewpoint += image.cam_from_world.CenterInB() / static_cast<double>(map.estimate.images.size());
  }
  for (const auto& [id, cluster] : map.semantics.clusters) {
    const SceneObject& object =
        scene.objects[static_cast<size_t>(map.object_of_cluster.at(id) - 1)];
    const bool planar_class =
        map.semantics.class_table.classes[static_cast<size_t>(cluster.class_index)].is_planar;
    if (object.plane_in_world && planar_class) {
      AddPlane(*object.plane_in_world, cluster, viewpoint, map);
    }
  }
}

}  // namespace s3lam::synthetic
