#pragma once

#include <ceres/manifold.h>

#include <Eigen/Core>
#include <array>

#include "s3lam/geometry/plane.h"
#include "s3lam/geometry/rigid3.h"

namespace s3lam {

/// A pose as one block of seven numbers: unit quaternion x, y, z, w, then translation, of
/// cam_from_world.
using PoseBlock = std::array<double, 7>;

PoseBlock ToPoseBlock(const Rigid3& cam_from_world);
Rigid3 FromPoseBlock(const double* pose);

/// 6 x 7 map from a change of the seven numbers (tangent to the unit quaternions) to the change
/// (w, v) of the pose, see PoseManifold; row-major.
using PoseMinusJacobian = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;
PoseMinusJacobian ComputePoseMinusJacobian(const double* pose);

/// Poses under a perturbation of the left side, delta = (w, v) with w a rotation vector [rad]:
///   x_c' = exp(w) (R x + t) + v,   i.e.   q' = exp(w) q,   t' = exp(w) t + v,
/// so that d x_c = w x x_c + v depends on the point in the camera only, and the camera centre moves
/// by -R^T v.
class PoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

/// Poses whose camera centre keeps its distance to a point in the world: the scale of the map.
/// delta = (w, a, b): rotation as above, and the centre's direction from that point moved along two
/// axes across it [rad].
class HeldDistancePoseManifold : public ceres::Manifold {
 public:
  explicit HeldDistancePoseManifold(const Eigen::Vector3d& held_from_in_world)
      : held_from_in_world_(held_from_in_world) {}

  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 5; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;

 private:
  Eigen::Vector3d held_from_in_world_;
};

/// A plane as four numbers (n, h): n . (x - anchor) + h = 0 with |n| = 1 and a constant anchor,
/// kept by who uses the block. With the anchor at the points' centroid the parameters are well
/// conditioned however far the scene lies from the origin. delta = (a, b, c): the normal turned
/// about two axes across it [rad], h moved by c.
class AnchoredPlaneManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 4; }
  int TangentSize() const override { return 3; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

/// The two axes across a unit vector that the manifolds above move it along.
Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& unit);

}  // namespace s3lam
