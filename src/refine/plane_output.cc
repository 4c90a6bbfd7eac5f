#include "s3lam/refine/plane_output.h"

#include <algorithm>

#include "s3lam/geometry/convex_hull.h"
#include "s3lam/robust/plane_fit.h"

namespace s3lam {
namespace {

nlohmann::json ToJson(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

void KeepPoints(const Reconstruction& refined, std::vector<PointId>& points) {
  std::erase_if(points, [&](PointId id) { return !refined.points.contains(id); });
}

/// Rows of points that are gone are removed from all tables.
void KeepRows(const Reconstruction& refined, SemanticMap& map) {
  Eigen::Index row = 0;
  for (size_t i = 0; i < map.points.size(); ++i) {
    if (!refined.points.contains(map.points[i])) continue;
    const auto to = static_cast<size_t>(row);
    map.points[to] = map.points[i];
    map.distributions.row(row) = map.distributions.row(static_cast<Eigen::Index>(i)).eval();
    map.num_mask_observations[to] = map.num_mask_observations[i];
    map.cluster_of_point[to] = map.cluster_of_point[i];
    ++row;
  }
  map.points.resize(static_cast<size_t>(row));
  map.distributions.conservativeResize(row, Eigen::NoChange);
  map.num_mask_observations.resize(static_cast<size_t>(row));
  map.cluster_of_point.resize(static_cast<size_t>(row));
}

/// Everything about a surface that follows from its plane and members.
void Describe(const PlaneModel& model, const BundleMap& map, const PlaneSigmaOptions& sigma,
              double sigma_px, size_t k, PlanarSurface& surface) {
  const PlaneState& state = model.planes[k];
  const BundleProblem& problem = map.problem;
  std::vector<UncertainPoint> points;
  std::vector<size_t> all;
  double squared = 0.0;
  double squared_sigma = 0.0;
  for (const int i : state.members) {
    const double distance = surface.plane_in_world.SignedDistance(problem.points[i]);
    const double s = PlaneSigma(sigma, model, sigma_px, state, i);
    squared += distance * distance;
    squared_sigma += distance * distance / (s * s);
    all.push_back(points.size());
    points.push_back({problem.points[i], s * s * Eigen::Matrix3d::Identity()});
  }
  const double n = static_cast<double>(points.size());
  surface.rms = std::sqrt(squared / n);
  surface.rms_sigma = std::sqrt(squared_sigma / n);
  const auto fit = FitPlane(points, all);
  if (!fit) return;
  // The refined plane stays; the fit only says where on it the points lie and how well they hold
  // it.
  surface.centroid_in_world = surface.plane_in_world.Project(fit->centroid);
  const Eigen::Vector3d& normal = surface.plane_in_world.normal;
  surface.axis_u_in_world = (fit->axis_u - normal.dot(fit->axis_u) * normal).normalized();
  surface.axis_v_in_world = normal.cross(surface.axis_u_in_world);
  surface.covariance = fit->covariance;
  std::vector<Eigen::Vector2d> uv;
  for (const int i : state.members) {
    const Eigen::Vector3d arm = problem.points[i] - surface.centroid_in_world;
    uv.emplace_back(surface.axis_u_in_world.dot(arm), surface.axis_v_in_world.dot(arm));
  }
  surface.extent = ConvexHull(std::move(uv));
}

}  // namespace

SemanticMap RefinedSemantics(const SemanticMap& original, const PlaneModel& planes,
                             const BundleMap& map, const Reconstruction& refined,
                             const PlaneSigmaOptions& sigma, double sigma_px) {
  SemanticMap result = original;
  KeepRows(refined, result);
  for (auto& [id, cluster] : result.clusters) {
    KeepPoints(refined, cluster.points);
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const PointId point : cluster.points) sum += refined.points.at(point).xyz;
    if (!cluster.points.empty()) {
      cluster.centroid_in_world = sum / static_cast<double>(cluster.points.size());
    }
  }
  result.planes.clear();
  for (size_t k = 0; k < planes.planes.size(); ++k) {
    const PlaneState& state = planes.planes[k];
    if (!state.in_use || state.members.empty()) continue;
    PlanarSurface surface;
    surface.id = state.id;
    surface.cluster_id = state.cluster_id;
    surface.class_index = state.class_index;
    surface.plane_in_world = map.problem.planes[k].PlaneInWorld();
    surface.inliers.clear();
    for (const int i : state.members) surface.inliers.push_back(map.point_ids[i]);
    Describe(planes, map, sigma, sigma_px, k, surface);
    KeepPoints(refined, surface.inliers);
    result.planes[state.id] = std::move(surface);
  }
  result.model_fingerprint = FingerprintOfModel(refined);
  return result;
}

nlohmann::json PlanesToJson(const SemanticMap& map) {
  nlohmann::json planes = nlohmann::json::array();
  for (const auto& [id, surface] : map.planes) {
    nlohmann::json outline = nlohmann::json::array();
    for (const Eigen::Vector2d& corner : surface.extent) {
      outline.push_back({corner.x(), corner.y()});
    }
    nlohmann::json inliers = nlohmann::json::array();
    for (const PointId point : surface.inliers) inliers.push_back(point.value());
    planes.push_back({{"id", id.value()},
                      {"class", map.class_table.classes.at(surface.class_index).name},
                      {"cluster_id", surface.cluster_id.value()},
                      {"normal_in_world", ToJson(surface.plane_in_world.normal)},
                      {"offset", surface.plane_in_world.offset},
                      {"centroid_in_world", ToJson(surface.centroid_in_world)},
                      {"axis_u_in_world", ToJson(surface.axis_u_in_world)},
                      {"axis_v_in_world", ToJson(surface.axis_v_in_world)},
                      {"extent_uv", outline},
                      {"points", surface.inliers.size()},
                      {"inliers", std::move(inliers)},
                      {"rms", surface.rms},
                      {"rms_sigma", surface.rms_sigma}});
  }
  return {{"format", "s3lam planes"}, {"version", 1}, {"planes", planes}};
}

}  // namespace s3lam
