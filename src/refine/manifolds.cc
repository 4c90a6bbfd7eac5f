#include "s3lam/refine/manifolds.h"

#include <Eigen/Geometry>
#include <cmath>

namespace s3lam {
namespace {

template <int kRows, int kCols>
using RowMajor = Eigen::Matrix<double, kRows, kCols, Eigen::RowMajor>;

using Vector6 = Eigen::Matrix<double, 6, 1>;

/// Moves a unit vector by `delta` (length = angle) along its tangent axes, on the great circle.
Eigen::Vector3d MoveOnSphere(const Eigen::Vector3d& unit, const Eigen::Vector2d& delta) {
  const double angle = delta.norm();
  const double sinc = angle > 1e-8 ? std::sin(angle) / angle : 1.0 - angle * angle / 6.0;
  return (std::cos(angle) * unit + sinc * (TangentBasis(unit) * delta)).normalized();
}

/// The inverse: MoveOnSphere(from, result) = to.
Eigen::Vector2d DifferenceOnSphere(const Eigen::Vector3d& to, const Eigen::Vector3d& from) {
  const Eigen::Vector2d across = TangentBasis(from).transpose() * to;
  const double sine = across.norm();
  const double angle = std::atan2(sine, from.dot(to));
  return sine > 1e-12 ? Eigen::Vector2d(across * (angle / sine)) : across;
}

}  // namespace

PoseBlock ToPoseBlock(const Rigid3& cam_from_world) {
  const Eigen::Quaterniond q = cam_from_world.rotation.normalized();
  const Eigen::Vector3d& t = cam_from_world.translation;
  return {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()};
}

Rigid3 FromPoseBlock(const double* pose) {
  return {Eigen::Quaterniond(pose[3], pose[0], pose[1], pose[2]).normalized(),
          Eigen::Vector3d(pose[4], pose[5], pose[6])};
}

Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& unit) {
  const auto [u, v] = PlaneAxes(unit);
  Eigen::Matrix<double, 3, 2> basis;
  basis << u, v;
  return basis;
}

PoseMinusJacobian ComputePoseMinusJacobian(const double* pose) {
  // From dq = 1/2 (w, 0) q: w = 2 vec(dq q^-1); from dt = w x t + v: v = dt + [t]_x w.
  const Eigen::Vector3d q(pose[0], pose[1], pose[2]);
  const Eigen::Vector3d t(pose[4], pose[5], pose[6]);
  PoseMinusJacobian jacobian = PoseMinusJacobian::Zero();
  jacobian.block<3, 3>(0, 0) = 2.0 * (pose[3] * Eigen::Matrix3d::Identity() + CrossMatrix(q));
  jacobian.block<3, 1>(0, 3) = -2.0 * q;
  jacobian.block<3, 4>(3, 0) = CrossMatrix(t) * jacobian.block<3, 4>(0, 0);
  jacobian.block<3, 3>(3, 4).setIdentity();
  return jacobian;
}

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const Rigid3 pose = FromPoseBlock(x);
  const Rigid3 change{QuaternionFromRotationVector({delta[0], delta[1], delta[2]}),
                      Eigen::Vector3d(delta[3], delta[4], delta[5])};
  const PoseBlock moved = ToPoseBlock(change * pose);
  std::copy(moved.begin(), moved.end(), x_plus_delta);
  return true;
}

bool PoseManifold::PlusJacobian(const double* x, double* jacobian) const {
  const Eigen::Vector3d q(x[0], x[1], x[2]);
  Eigen::Map<RowMajor<7, 6>> j(jacobian);
  j.setZero();
  j.block<3, 3>(0, 0) = 0.5 * (x[3] * Eigen::Matrix3d::Identity() - CrossMatrix(q));
  j.block<1, 3>(3, 0) = -0.5 * q.transpose();
  j.block<3, 3>(4, 0) = -CrossMatrix({x[4], x[5], x[6]});
  j.block<3, 3>(4, 3).setIdentity();
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Rigid3 change = FromPoseBlock(y) * FromPoseBlock(x).Inverse();
  Eigen::Map<Vector6> delta(y_minus_x);
  delta << RotationVectorFromQuaternion(change.rotation), change.translation;
  return true;
}

bool PoseManifold::MinusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<PoseMinusJacobian> j(jacobian);
  j = ComputePoseMinusJacobian(x);
  return true;
}

bool HeldDistancePoseManifold::Plus(const double* x, const double* delta,
                                    double* x_plus_delta) const {
  const Rigid3 pose = FromPoseBlock(x);
  const Eigen::Vector3d arm = pose.CenterInB() - held_from_in_world_;
  const Eigen::Vector3d direction = MoveOnSphere(arm.normalized(), {delta[3], delta[4]});
  const Eigen::Vector3d center = held_from_in_world_ + arm.norm() * direction;
  const Eigen::Quaterniond rotation =
      (QuaternionFromRotationVector({delta[0], delta[1], delta[2]}) * pose.rotation).normalized();
  const PoseBlock moved = ToPoseBlock({rotation, -(rotation * center)});
  std::copy(moved.begin(), moved.end(), x_plus_delta);
  return true;
}

bool HeldDistancePoseManifold::PlusJacobian(const double* x, double* jacobian) const {
  // t = -R C: a turn w about the fixed centre gives dt = w x t; moving the centre gives -R dC.
  const Rigid3 pose = FromPoseBlock(x);
  const Eigen::Vector3d arm = pose.CenterInB() - held_from_in_world_;
  const Eigen::Vector3d q(x[0], x[1], x[2]);
  Eigen::Map<RowMajor<7, 5>> j(jacobian);
  j.setZero();
  j.block<3, 3>(0, 0) = 0.5 * (x[3] * Eigen::Matrix3d::Identity() - CrossMatrix(q));
  j.block<1, 3>(3, 0) = -0.5 * q.transpose();
  j.block<3, 3>(4, 0) = -CrossMatrix(pose.translation);
  j.block<3, 2>(4, 3) =
      -(pose.rotation.toRotationMatrix() * (arm.norm() * TangentBasis(arm.normalized())));
  return true;
}

bool HeldDistancePoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Rigid3 pose_y = FromPoseBlock(y);
  const Rigid3 pose_x = FromPoseBlock(x);
  const Eigen::Vector3d rotation =
      RotationVectorFromQuaternion(pose_y.rotation * pose_x.rotation.conjugate());
  const Eigen::Vector2d direction =
      DifferenceOnSphere((pose_y.CenterInB() - held_from_in_world_).normalized(),
                         (pose_x.CenterInB() - held_from_in_world_).normalized());
  Eigen::Map<Eigen::Matrix<double, 5, 1>> delta(y_minus_x);
  delta << rotation, direction;
  return true;
}

bool HeldDistancePoseManifold::MinusJacobian(const double* x, double* jacobian) const {
  const Rigid3 pose = FromPoseBlock(x);
  const Eigen::Vector3d arm = pose.CenterInB() - held_from_in_world_;
  const PoseMinusJacobian full = ComputePoseMinusJacobian(x);
  // v = -R dC, so the centre's change across the arm, in radians, is -B^T R^T v / |arm|.
  const Eigen::Matrix<double, 2, 3> angle_from_v = -TangentBasis(arm.normalized()).transpose() *
                                                   pose.rotation.conjugate().toRotationMatrix() /
                                                   arm.norm();
  Eigen::Map<RowMajor<5, 7>> j(jacobian);
  j.topRows<3>() = full.topRows<3>();
  j.bottomRows<2>() = angle_from_v * full.bottomRows<3>();
  return true;
}

bool AnchoredPlaneManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const Eigen::Map<const Eigen::Vector3d> normal(x);
  Eigen::Map<Eigen::Vector3d> moved(x_plus_delta);
  const double offset = x[3] + delta[2];
  moved = MoveOnSphere(normal, {delta[0], delta[1]});
  x_plus_delta[3] = offset;
  return true;
}

bool AnchoredPlaneManifold::PlusJacobian(const double* x, double* jacobian) const {
  const Eigen::Map<const Eigen::Vector3d> normal(x);
  Eigen::Map<RowMajor<4, 3>> j(jacobian);
  j.setZero();
  j.block<3, 2>(0, 0) = TangentBasis(normal);
  j(3, 2) = 1.0;
  return true;
}

bool AnchoredPlaneManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Eigen::Map<const Eigen::Vector3d> to(y);
  const Eigen::Map<const Eigen::Vector3d> from(x);
  const Eigen::Vector2d delta = DifferenceOnSphere(to, from);
  y_minus_x[0] = delta[0];
  y_minus_x[1] = delta[1];
  y_minus_x[2] = y[3] - x[3];
  return true;
}

bool AnchoredPlaneManifold::MinusJacobian(const double* x, double* jacobian) const {
  const Eigen::Map<const Eigen::Vector3d> normal(x);
  Eigen::Map<RowMajor<3, 4>> j(jacobian);
  j.setZero();
  j.block<2, 3>(0, 0) = TangentBasis(normal).transpose();
  j(2, 3) = 1.0;
  return true;
}

}  // namespace s3lam
