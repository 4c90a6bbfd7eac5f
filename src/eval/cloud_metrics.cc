#include "s3lam/eval/cloud_metrics.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

namespace s3lam {
namespace {

/// Fewer fit any plane.
constexpr size_t kMinPoints = 4;

/// Value at a share of a sorted list, linear between its members.
double Quantile(const std::vector<double>& sorted, double share) {
  const double place = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<size_t>(place);
  const size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (place - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

void FitPlane(const std::vector<Eigen::Vector3d>& points, PlaneCloud& cloud) {
  const auto count = static_cast<double>(points.size());
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& x : points) centroid += x;
  centroid /= count;
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& x : points) scatter += (x - centroid) * (x - centroid).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter / count);
  const Eigen::Vector3d normal = solver.eigenvectors().col(0);
  cloud.best.plane = {normal, -normal.dot(centroid)};
  cloud.best.centroid = centroid;
  cloud.extent = std::sqrt(std::max(0.0, solver.eigenvalues()[2]));
}

std::optional<PlaneCloud> MeasureCloud(const Reconstruction& model, const SemanticMap& map,
                                       const PlanarSurface& surface, double unit) {
  PlaneCloud cloud;
  std::vector<Eigen::Vector3d> points;
  for (const PointId id : surface.inliers) {
    const auto point = model.points.find(id);
    if (point != model.points.end()) points.push_back(point->second.xyz);
  }
  if (points.size() < kMinPoints) return std::nullopt;
  const SemanticClass& c = map.class_table.classes.at(static_cast<size_t>(surface.class_index));
  cloud.best.id = surface.id;
  cloud.best.label = c.name;
  cloud.best.num_points = points.size();
  cloud.num_missing = surface.inliers.size() - points.size();
  FitPlane(points, cloud);
  std::vector<double> distances;
  for (const Eigen::Vector3d& x : points) {
    distances.push_back(unit * cloud.best.plane.SignedDistance(x));
  }
  std::sort(distances.begin(), distances.end());
  cloud.thickness = Quantile(distances, 0.95) - Quantile(distances, 0.05);
  for (double& distance : distances) distance = std::abs(distance);
  const ErrorStatistics statistics = ComputeErrorStatistics(std::move(distances));
  cloud.rms = statistics.rmse;
  cloud.median = statistics.median;
  cloud.extent *= unit;
  return cloud;
}

}  // namespace

std::vector<PlaneCloud> MeasurePlaneClouds(const Reconstruction& model, const SemanticMap& map,
                                           double truth_units_per_unit) {
  std::vector<PlaneCloud> clouds;
  for (const auto& [id, surface] : map.planes) {
    const auto cloud = MeasureCloud(model, map, surface, truth_units_per_unit);
    if (cloud) clouds.push_back(*cloud);
  }
  return clouds;
}

std::vector<FittedPlane> BestPlanes(const std::vector<PlaneCloud>& clouds) {
  std::vector<FittedPlane> planes;
  for (const PlaneCloud& cloud : clouds) planes.push_back(cloud.best);
  return planes;
}

nlohmann::json ToJson(const std::vector<PlaneCloud>& clouds) {
  nlohmann::json list = nlohmann::json::array();
  std::vector<double> rms;
  std::vector<double> thickness;
  for (const PlaneCloud& cloud : clouds) {
    list.push_back({{"plane", cloud.best.id.value()},
                    {"class", cloud.best.label},
                    {"points", cloud.best.num_points},
                    {"missing", cloud.num_missing},
                    {"rms", cloud.rms},
                    {"median", cloud.median},
                    {"thickness", cloud.thickness},
                    {"extent", cloud.extent}});
    rms.push_back(cloud.rms);
    thickness.push_back(cloud.thickness);
  }
  return {{"planes", list},
          {"rms", ToJson(ComputeErrorStatistics(std::move(rms)))},
          {"thickness", ToJson(ComputeErrorStatistics(std::move(thickness)))}};
}

std::string ToTable(const std::vector<PlaneCloud>& clouds) {
  std::string table = fmt::format("{:<28}{:>8}{:>8}{:>12}{:>12}{:>12}{:>12}\n", "points of plane",
                                  "points", "missing", "rms", "median", "5 to 95 %", "extent");
  for (const PlaneCloud& cloud : clouds) {
    table += fmt::format("{:<28}{:>8}{:>8}{:>12.6f}{:>12.6f}{:>12.6f}{:>12.4f}\n",
                         fmt::format("{} {}", cloud.best.id.value(), cloud.best.label),
                         cloud.best.num_points, cloud.num_missing, cloud.rms, cloud.median,
                         cloud.thickness, cloud.extent);
  }
  return table;
}

}  // namespace s3lam
