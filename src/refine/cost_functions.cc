#include "s3lam/refine/cost_functions.h"

#include <Eigen/Geometry>

#include "s3lam/base/error.h"
#include "s3lam/refine/manifolds.h"
#include "s3lam/refine/projection.h"

namespace s3lam {
namespace {

using Vector3Map = Eigen::Map<const Eigen::Vector3d>;

template <int kRows, int kCols>
using RowMajorMap =
    Eigen::Map<Eigen::Matrix<double, kRows, kCols,
                             kRows == 1 ? Eigen::RowMajor | Eigen::DontAlign : Eigen::RowMajor>>;

/// d(R X + t) / d(seven numbers of the pose), projected by A = d(pixel) / d(point in camera):
/// w turns x_c = R X + t by -[x_c]_x and t moves it by one, which leaves -A [R X]_x for the
/// quaternion (see ComputePoseMinusJacobian).
void PoseJacobian(const Matrix23& a, const double* pose, const Eigen::Vector3d& rotated,
                  double* jacobian) {
  RowMajorMap<2, 7> j(jacobian);
  const PoseMinusJacobian minus = ComputePoseMinusJacobian(pose);
  j.leftCols<4>() = -(a * CrossMatrix(rotated)) * minus.block<3, 4>(0, 0);
  j.rightCols<3>() = a;
}

}  // namespace

ReprojectionCost::ReprojectionCost(CameraModel model, const Eigen::Vector2d& pixel, double sigma_px)
    : pixel_(pixel), inverse_sigma_(1.0 / sigma_px), model_(model) {
  S3LAM_CHECK(sigma_px > 0.0);
  set_num_residuals(2);
  *mutable_parameter_block_sizes() = {7, 3, CameraModelNumParams(model)};
}

bool ReprojectionCost::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  const double* pose = parameters[0];
  const double* camera = parameters[2];
  const Eigen::Matrix3d rotation =
      Eigen::Quaterniond(pose[3], pose[0], pose[1], pose[2]).toRotationMatrix();
  const Eigen::Vector3d rotated = rotation * Vector3Map(parameters[1]);
  const Eigen::Vector3d point_in_camera = rotated + Vector3Map(pose + 4);
  Eigen::Vector2d pixel;
  Matrix23 by_point;
  const bool want_point =
      jacobians != nullptr && (jacobians[0] != nullptr || jacobians[1] != nullptr);
  if (!ProjectPoint(model_, camera, point_in_camera, &pixel, want_point ? &by_point : nullptr)) {
    return false;
  }
  residuals[0] = (pixel.x() - pixel_.x()) * inverse_sigma_;
  residuals[1] = (pixel.y() - pixel_.y()) * inverse_sigma_;
  if (jacobians == nullptr) return true;
  if (want_point) by_point *= inverse_sigma_;
  if (jacobians[0] != nullptr) PoseJacobian(by_point, pose, rotated, jacobians[0]);
  if (jacobians[1] != nullptr) RowMajorMap<2, 3>{jacobians[1]} = by_point * rotation;
  if (jacobians[2] != nullptr) {
    ProjectionParamsJacobian(model_, camera, point_in_camera, jacobians[2]);
    for (int i = 0; i < 2 * CameraModelNumParams(model_); ++i) jacobians[2][i] *= inverse_sigma_;
  }
  return true;
}

PointFixedPlaneCost::PointFixedPlaneCost(const Eigen::Vector4d& plane_in_world, double sigma)
    : scaled_plane_(plane_in_world / sigma) {
  S3LAM_CHECK(sigma > 0.0);
}

bool PointFixedPlaneCost::Evaluate(double const* const* parameters, double* residuals,
                                   double** jacobians) const {
  residuals[0] = scaled_plane_.head<3>().dot(Vector3Map(parameters[0])) + scaled_plane_[3];
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    Eigen::Map<Eigen::Vector3d>{jacobians[0]} = scaled_plane_.head<3>();
  }
  return true;
}

PointPlaneCost::PointPlaneCost(const Eigen::Vector3d& anchor_in_world, double sigma)
    : anchor_in_world_(anchor_in_world), inverse_sigma_(1.0 / sigma) {
  S3LAM_CHECK(sigma > 0.0);
}

bool PointPlaneCost::Evaluate(double const* const* parameters, double* residuals,
                              double** jacobians) const {
  const Eigen::Vector3d arm = Vector3Map(parameters[0]) - anchor_in_world_;
  const Vector3Map normal(parameters[1]);
  residuals[0] = (normal.dot(arm) + parameters[1][3]) * inverse_sigma_;
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) {
    Eigen::Map<Eigen::Vector3d>{jacobians[0]} = normal * inverse_sigma_;
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Eigen::Vector4d>{jacobians[1]} << arm * inverse_sigma_, inverse_sigma_;
  }
  return true;
}

CameraHeightCost::CameraHeightCost(const Eigen::Vector3d& anchor_in_world, double sigma_relative)
    : anchor_in_world_(anchor_in_world), inverse_sigma_(1.0 / sigma_relative) {
  S3LAM_CHECK(sigma_relative > 0.0);
}

bool CameraHeightCost::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  const double height = parameters[2][0];
  if (!(height > 0.0)) return false;
  const double* pose = parameters[0];
  const Eigen::Quaterniond rotation(pose[3], pose[0], pose[1], pose[2]);
  const Eigen::Vector3d arm = -(rotation.conjugate() * Vector3Map(pose + 4)) - anchor_in_world_;
  const Vector3Map normal(parameters[1]);
  const double height_i = normal.dot(arm) + parameters[1][3];
  residuals[0] = (height_i / height - 1.0) * inverse_sigma_;
  if (jacobians == nullptr) return true;
  const double scale = inverse_sigma_ / height;
  if (jacobians[0] != nullptr) {
    // The centre C moves by -R^T v and not with w (see PoseManifold).
    const Eigen::RowVector3d by_v = -scale * (rotation * normal).transpose();
    RowMajorMap<1, 7>{jacobians[0]} = by_v * ComputePoseMinusJacobian(pose).bottomRows<3>();
  }
  if (jacobians[1] != nullptr) Eigen::Map<Eigen::Vector4d>{jacobians[1]} << arm * scale, scale;
  if (jacobians[2] != nullptr) jacobians[2][0] = -scale * height_i / height;
  return true;
}

bool ParallelPlanesCost::Evaluate(double const* const* parameters, double* residuals,
                                  double** jacobians) const {
  const Vector3Map a(parameters[0]);
  const Vector3Map b(parameters[1]);
  Eigen::Map<Eigen::Vector3d>{residuals} = a.cross(b) * inverse_sigma_;
  if (jacobians == nullptr) return true;
  const Eigen::Vector3d normals[2] = {-b, a};  // d(a x b) = -[b]_x da + [a]_x db
  for (int i = 0; i < 2; ++i) {
    if (jacobians[i] == nullptr) continue;
    RowMajorMap<3, 4> j(jacobians[i]);
    j.leftCols<3>() = CrossMatrix(normals[i]) * inverse_sigma_;
    j.col(3).setZero();
  }
  return true;
}

bool OrthogonalPlanesCost::Evaluate(double const* const* parameters, double* residuals,
                                    double** jacobians) const {
  const Vector3Map a(parameters[0]);
  const Vector3Map b(parameters[1]);
  residuals[0] = a.dot(b) * inverse_sigma_;
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) Eigen::Map<Eigen::Vector4d>{jacobians[0]} << b * inverse_sigma_, 0.0;
  if (jacobians[1] != nullptr) Eigen::Map<Eigen::Vector4d>{jacobians[1]} << a * inverse_sigma_, 0.0;
  return true;
}

PlanesMeetCost::PlanesMeetCost(const Eigen::Vector3d& arm_a, const Eigen::Vector3d& arm_b,
                               bool opposite, double step, double sigma)
    : scale_a_(1.0 / sigma), scale_b_((opposite ? 1.0 : -1.0) / sigma), scaled_step_(step / sigma) {
  S3LAM_CHECK(sigma > 0.0);
  scaled_arm_a_ = arm_a * scale_a_;
  scaled_arm_b_ = arm_b * scale_b_;
}

bool PlanesMeetCost::Evaluate(double const* const* parameters, double* residuals,
                              double** jacobians) const {
  const Vector3Map a(parameters[0]);
  const Vector3Map b(parameters[1]);
  residuals[0] = a.dot(scaled_arm_a_) + parameters[0][3] * scale_a_ + b.dot(scaled_arm_b_) +
                 parameters[1][3] * scale_b_ - scaled_step_;
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) Eigen::Map<Eigen::Vector4d>{jacobians[0]} << scaled_arm_a_, scale_a_;
  if (jacobians[1] != nullptr) Eigen::Map<Eigen::Vector4d>{jacobians[1]} << scaled_arm_b_, scale_b_;
  return true;
}

}  // namespace s3lam
