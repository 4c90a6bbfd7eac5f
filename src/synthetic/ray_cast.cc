#include "s3lam/synthetic/ray_cast.h"

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <numbers>

namespace s3lam {
namespace {

std::optional<double> CastPolygon(const Surface& surface, const Eigen::Vector3d& origin,
                                  const Eigen::Vector3d& direction) {
  const auto& c = surface.corners;
  const Eigen::Vector3d normal = (c[1] - c[0]).cross(c[2] - c[0]);
  const double slope = normal.dot(direction);
  if (std::abs(slope) < 1e-15) return std::nullopt;
  const double depth = normal.dot(c[0] - origin) / slope;
  if (!(depth > 0.0)) return std::nullopt;
  const Eigen::Vector3d x = origin + depth * direction;
  for (size_t i = 0; i < c.size(); ++i) {
    const Eigen::Vector3d& from = c[i];
    const Eigen::Vector3d& to = c[(i + 1) % c.size()];
    if (normal.dot((to - from).cross(x - from)) < 0.0) return std::nullopt;
  }
  return depth;
}

std::optional<double> CastCurved(const Surface& surface, const Eigen::Vector3d& origin,
                                 const Eigen::Vector3d& direction) {
  const Eigen::Quaterniond local_from_world = surface.world_from_local.rotation.conjugate();
  const Eigen::Vector3d o = (local_from_world * (origin - surface.world_from_local.translation))
                                .cwiseQuotient(surface.radii);
  const Eigen::Vector3d d = (local_from_world * direction).cwiseQuotient(surface.radii);
  const int n = surface.shape == SurfaceShape::kCylinder ? 2 : 3;
  const double a = d.head(n).squaredNorm();
  const double b = o.head(n).dot(d.head(n));
  const double discriminant = b * b - a * (o.head(n).squaredNorm() - 1.0);
  if (!(discriminant >= 0.0) || a < 1e-300) return std::nullopt;
  const double root = std::sqrt(discriminant);
  for (const double depth : {(-b - root) / a, (-b + root) / a}) {
    if (!(depth > 0.0)) continue;
    const Eigen::Vector3d x = o + depth * d;
    if (x.z() < surface.z_min || x.z() > surface.z_max) continue;
    const double angle = std::atan2(x.y(), x.x());
    if (angle < surface.angle_min || angle > surface.angle_max) continue;
    return depth;
  }
  return std::nullopt;
}

std::optional<double> CastSurface(const Surface& surface, const Eigen::Vector3d& origin,
                                  const Eigen::Vector3d& direction) {
  return surface.shape == SurfaceShape::kPolygon ? CastPolygon(surface, origin, direction)
                                                 : CastCurved(surface, origin, direction);
}

}  // namespace

std::vector<Eigen::Vector3d> BoundingPoints(const Surface& surface) {
  if (surface.shape == SurfaceShape::kPolygon) return surface.corners;
  // The arc's extent: its ends, and the axes' directions that lie within it.
  Eigen::Vector2d low(1.0, 1.0);
  Eigen::Vector2d high(-1.0, -1.0);
  const auto include = [&](double angle) {
    const Eigen::Vector2d on_arc(std::cos(angle), std::sin(angle));
    low = low.cwiseMin(on_arc);
    high = high.cwiseMax(on_arc);
  };
  include(std::max(surface.angle_min, -std::numbers::pi));
  include(std::min(surface.angle_max, std::numbers::pi));
  for (int quarter = -2; quarter <= 2; ++quarter) {
    const double angle = 0.5 * std::numbers::pi * quarter;
    if (angle >= surface.angle_min && angle <= surface.angle_max) include(angle);
  }
  if (surface.shape == SurfaceShape::kEllipsoid) {  // Its parallels reach further in.
    low = low.cwiseMin(0.0);
    high = high.cwiseMax(0.0);
  }
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector3d corner((i & 1) != 0 ? high.x() : low.x(),
                                 (i & 2) != 0 ? high.y() : low.y(),
                                 (i & 4) != 0 ? surface.z_max : surface.z_min);
    points.push_back(surface.world_from_local * surface.radii.cwiseProduct(corner));
  }
  return points;
}

RayCaster::RayCaster(const Scene& scene) : surfaces_(scene.surfaces) {
  for (const Surface& surface : surfaces_) {
    const std::vector<Eigen::Vector3d> points = BoundingPoints(surface);
    Eigen::Vector3d low = points.front();
    Eigen::Vector3d high = points.front();
    for (const Eigen::Vector3d& point : points) {
      low = low.cwiseMin(point);
      high = high.cwiseMax(point);
    }
    bounds_.push_back({0.5 * (low + high), 0.25 * (high - low).squaredNorm() + 1e-9});
  }
}

std::optional<RayHit> RayCaster::Cast(const Eigen::Vector3d& origin,
                                      const Eigen::Vector3d& direction) const {
  const double inverse_squared_length = 1.0 / direction.squaredNorm();
  std::optional<RayHit> nearest;
  for (size_t i = 0; i < surfaces_.size(); ++i) {
    const Eigen::Vector3d to_center = bounds_[i].center - origin;
    const double along = to_center.dot(direction) * inverse_squared_length;
    if ((to_center - along * direction).squaredNorm() > bounds_[i].squared_radius) continue;
    const std::optional<double> depth = CastSurface(surfaces_[i], origin, direction);
    if (depth && (!nearest || *depth < nearest->depth)) nearest = {*depth, static_cast<int>(i)};
  }
  return nearest;
}

bool RayCaster::Sees(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                     double tolerance) const {
  const Eigen::Vector3d direction = (to - from).normalized();
  const std::optional<RayHit> hit = Cast(from, direction);
  return !hit || hit->depth > (to - from).norm() - tolerance;
}

}  // namespace s3lam
