#include "s3lam/geometry/triangulation.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

namespace s3lam {
namespace {

constexpr int kRefinementSteps = 2;

/// One Gauss-Newton step on sum || (x/z, y/z) - normalized ||^2; false if it is not defined.
bool RefineStep(std::span<const ViewingRay> rays, Eigen::Vector3d& point) {
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  for (const ViewingRay& ray : rays) {
    const Eigen::Vector3d x = ray.cam_from_world * point;
    if (x.z() <= 1e-12) return false;
    const double inverse_z = 1.0 / x.z();
    Eigen::Matrix<double, 2, 3> projection;
    projection << inverse_z, 0.0, -x.x() * inverse_z * inverse_z, 0.0, inverse_z,
        -x.y() * inverse_z * inverse_z;
    const Eigen::Matrix<double, 2, 3> jacobian =
        projection * ray.cam_from_world.rotation.toRotationMatrix();
    const Eigen::Vector2d residual = x.head<2>() * inverse_z - ray.normalized;
    hessian.noalias() += jacobian.transpose() * jacobian;
    gradient.noalias() += jacobian.transpose() * residual;
  }
  const Eigen::Vector3d step = hessian.ldlt().solve(gradient);
  if (!step.allFinite()) return false;
  point -= step;
  return true;
}

}  // namespace

std::optional<Eigen::Vector3d> Triangulate(std::span<const ViewingRay> rays) {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const ViewingRay& ray : rays) {
    const Eigen::Vector3d direction =
        ray.cam_from_world.rotation.conjugate() * ray.normalized.homogeneous().normalized();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - direction * direction.transpose();
    matrix += across;
    right += across * ray.cam_from_world.CenterInB();
  }
  if (std::abs(matrix.determinant()) < 1e-14) return std::nullopt;
  Eigen::Vector3d point = matrix.ldlt().solve(right);
  for (int step = 0; step < kRefinementSteps; ++step) {
    if (!RefineStep(rays, point)) return std::nullopt;
  }
  for (const ViewingRay& ray : rays) {
    if (!((ray.cam_from_world * point).z() > 0.0)) return std::nullopt;
  }
  return point;
}

double ParallaxAngle(const Eigen::Vector3d& point, const Eigen::Vector3d& center_a,
                     const Eigen::Vector3d& center_b) {
  const Eigen::Vector3d a = point - center_a;
  const Eigen::Vector3d b = point - center_b;
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace s3lam
