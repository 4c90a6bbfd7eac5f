#pragma once

#include "s3lam/geometry/rigid3.h"

namespace s3lam {

/// Similarity x_a = scale * R * x_b + t.
struct Similarity3 {
  double scale = 1.0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& x) const {
    return scale * (rotation * x) + translation;
  }
  Similarity3 operator*(const Similarity3& b) const {
    return {scale * b.scale, (rotation * b.rotation).normalized(),
            scale * (rotation * b.translation) + translation};
  }
  [[nodiscard]] Similarity3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {1.0 / scale, inverse, -(inverse * translation) / scale};
  }
};

/// The pose of a camera in world a, given its pose in world b: cam_from_a in a's scale.
inline Rigid3 TransformCameraPose(const Similarity3& a_from_b, const Rigid3& cam_from_b) {
  const Eigen::Quaterniond rotation =
      (cam_from_b.rotation * a_from_b.rotation.conjugate()).normalized();
  const Eigen::Vector3d center_in_a = a_from_b * cam_from_b.CenterInB();
  return {rotation, -(rotation * center_in_a)};
}

}  // namespace s3lam
