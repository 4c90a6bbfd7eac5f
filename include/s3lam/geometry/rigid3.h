#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace s3lam {

/// Rigid transform x_a = a_from_b * x_b, with a unit quaternion.
struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& x) const { return rotation * x + translation; }
  Rigid3 operator*(const Rigid3& b) const {
    return {(rotation * b.rotation).normalized(), rotation * b.translation + translation};
  }
  [[nodiscard]] Rigid3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {inverse, -(inverse * translation)};
  }
  /// The origin of frame b in frame b's own coordinates of a: for cam_from_world, the camera centre
  /// in the world.
  [[nodiscard]] Eigen::Vector3d CenterInB() const { return -(rotation.conjugate() * translation); }
};

/// Rotation vector (axis * angle, rad) to unit quaternion; exact near zero.
inline Eigen::Quaterniond QuaternionFromRotationVector(const Eigen::Vector3d& omega) {
  const double half = 0.5 * omega.norm();
  // sin(half)/angle -> 1/2 as the angle vanishes.
  const double scale = half > 1e-8 ? 0.5 * std::sin(half) / half : 0.5 - half * half / 12.0;
  Eigen::Quaterniond q;
  q.w() = std::cos(half);
  q.vec() = scale * omega;
  return q.normalized();
}

/// Unit quaternion to rotation vector (rad), angle in [0, pi].
inline Eigen::Vector3d RotationVectorFromQuaternion(const Eigen::Quaterniond& q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  const double sine = q.vec().norm();
  if (sine < 1e-12) return 2.0 * sign * q.vec();
  return (2.0 * std::atan2(sine, sign * q.w()) / sine) * sign * q.vec();
}

/// Angle between two rotations [rad].
inline double RotationAngle(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return RotationVectorFromQuaternion(a.conjugate() * b).norm();
}

/// The matrix [v]_x with [v]_x w = v x w.
inline Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

}  // namespace s3lam
