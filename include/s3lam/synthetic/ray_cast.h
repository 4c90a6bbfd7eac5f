#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "s3lam/synthetic/scene.h"

namespace s3lam {

struct RayHit {
  double depth = 0.0;  // In units of the ray's direction.
  int surface = 0;     // Index into Scene::surfaces.
};

/// Exact visibility for single rays (rendering has its own, faster way).
class RayCaster {
 public:
  /// Keeps a reference to the scene's surfaces.
  explicit RayCaster(const Scene& scene);

  /// The first surface hit by origin + depth * direction at depth > 0.
  [[nodiscard]] std::optional<RayHit> Cast(const Eigen::Vector3d& origin,
                                           const Eigen::Vector3d& direction) const;
  /// True if nothing lies between the two points; the last `tolerance` metres before `to` do not
  /// count.
  [[nodiscard]] bool Sees(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                          double tolerance = 1e-3) const;

 private:
  struct Bound {
    Eigen::Vector3d center;
    double squared_radius;
  };
  const std::vector<Surface>& surfaces_;
  std::vector<Bound> bounds_;
};

/// A point of the surface's bounding frame: the corners of a polygon, or of the box around a curved
/// surface, in the world.
std::vector<Eigen::Vector3d> BoundingPoints(const Surface& surface);

}  // namespace s3lam
