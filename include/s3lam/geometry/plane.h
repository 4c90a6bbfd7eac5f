#pragma once

#include <Eigen/Core>

#include "s3lam/geometry/similarity3.h"

namespace s3lam {

/// The plane normal . x + offset = 0 with a unit normal (not the paper's unit 4-vector; the two are
/// the same plane up to a factor).
struct Plane {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double offset = 0.0;

  [[nodiscard]] double SignedDistance(const Eigen::Vector3d& x) const {
    return normal.dot(x) + offset;
  }
  [[nodiscard]] Eigen::Vector3d Project(const Eigen::Vector3d& x) const {
    return x - SignedDistance(x) * normal;
  }
};

/// The same plane in world a.
inline Plane TransformPlane(const Similarity3& a_from_b, const Plane& plane_in_b) {
  const Eigen::Vector3d normal = a_from_b.rotation * plane_in_b.normal;
  return {normal, a_from_b.scale * plane_in_b.offset - normal.dot(a_from_b.translation)};
}

/// Angle between two planes, i.e. between their normals up to sign [rad], in [0, pi/2].
inline double PlaneAngle(const Plane& a, const Plane& b) {
  return std::atan2(a.normal.cross(b.normal).norm(), std::abs(a.normal.dot(b.normal)));
}

/// Two unit vectors that span the plane and make a right-handed frame with the normal.
inline std::pair<Eigen::Vector3d, Eigen::Vector3d> PlaneAxes(const Eigen::Vector3d& normal) {
  const Eigen::Vector3d u = normal.unitOrthogonal();
  return {u, normal.cross(u)};
}

}  // namespace s3lam
