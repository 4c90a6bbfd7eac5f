#include "s3lam/refine/pose_prior_cost.h"

#include <Eigen/Geometry>
#include <cmath>

#include "s3lam/base/error.h"
#include "s3lam/refine/manifolds.h"

namespace s3lam {
namespace {

/// d(log(exp(w) R)) / dw at w = 0, for R = exp(r): the inverse of the left Jacobian of SO(3).
Eigen::Matrix3d InverseLeftJacobian(const Eigen::Vector3d& r) {
  const Eigen::Matrix3d cross = CrossMatrix(r);
  const double angle = r.norm();
  const double factor =
      angle > 1e-4 ? 1.0 / (angle * angle) - 0.5 / (angle * std::tan(0.5 * angle)) : 1.0 / 12.0;
  return Eigen::Matrix3d::Identity() - 0.5 * cross + factor * cross * cross;
}

}  // namespace

PosePriorCost::PosePriorCost(const Rigid3& cam_from_world, double sigma_position,
                             double sigma_rotation)
    : cam_from_world_(cam_from_world),
      position_weight_(sigma_position > 0.0 ? 1.0 / sigma_position : 0.0),
      rotation_weight_(sigma_rotation > 0.0 ? 1.0 / sigma_rotation : 0.0) {
  S3LAM_CHECK(sigma_position >= 0.0 && sigma_rotation >= 0.0);
}

bool PosePriorCost::Evaluate(double const* const* parameters, double* residuals,
                             double** jacobians) const {
  const Rigid3 pose = FromPoseBlock(parameters[0]);
  const Eigen::Vector3d turn =
      RotationVectorFromQuaternion(pose.rotation * cam_from_world_.rotation.conjugate());
  Eigen::Map<Eigen::Vector3d>{residuals} =
      position_weight_ * (pose.CenterInB() - cam_from_world_.CenterInB());
  Eigen::Map<Eigen::Vector3d>{residuals + 3} = rotation_weight_ * turn;
  if (jacobians == nullptr || jacobians[0] == nullptr) return true;
  // The centre moves by -R^T v and not with w (see PoseManifold).
  const PoseMinusJacobian minus = ComputePoseMinusJacobian(parameters[0]);
  Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> j(jacobians[0]);
  j.topRows<3>() =
      -position_weight_ * pose.rotation.conjugate().toRotationMatrix() * minus.bottomRows<3>();
  j.bottomRows<3>() = rotation_weight_ * InverseLeftJacobian(turn) * minus.topRows<3>();
  return true;
}

}  // namespace s3lam
