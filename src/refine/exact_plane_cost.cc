#include "s3lam/refine/exact_plane_cost.h"

#include <cmath>

namespace s3lam {
namespace {

/// A plane at right angles to its frame has no point with given coordinates [cosine].
constexpr double kLeastCosine = 0.1;

}  // namespace

PlaneFrame PlaneFrame::Of(const AnchoredPlane& plane) {
  const Eigen::Vector3d normal = plane.parameters.head<3>();
  const auto [u, v] = PlaneAxes(normal);
  return {plane.anchor_in_world, u, v, normal};
}

bool PointInPlane(const PlaneFrame& frame, const double* plane, const double* coordinates,
                  Eigen::Vector3d* point_in_world, Eigen::Matrix<double, 3, 2>* by_coordinates,
                  Eigen::Matrix<double, 3, 4>* by_plane) {
  const Eigen::Map<const Eigen::Vector3d> normal(plane);
  const double cosine = normal.dot(frame.e3);
  if (!(std::abs(cosine) > kLeastCosine)) return false;
  const Eigen::Vector3d level = coordinates[0] * frame.e1 + coordinates[1] * frame.e2;
  const double s = -(normal.dot(level) + plane[3]) / cosine;
  const Eigen::Vector3d arm = level + s * frame.e3;
  *point_in_world = frame.anchor_in_world + arm;
  if (by_coordinates != nullptr) {
    by_coordinates->col(0) = frame.e1 - (normal.dot(frame.e1) / cosine) * frame.e3;
    by_coordinates->col(1) = frame.e2 - (normal.dot(frame.e2) / cosine) * frame.e3;
  }
  if (by_plane != nullptr) {
    by_plane->leftCols<3>() = -frame.e3 * arm.transpose() / cosine;
    by_plane->col(3) = -frame.e3 / cosine;
  }
  return true;
}

ExactPlaneReprojectionCost::ExactPlaneReprojectionCost(CameraModel model,
                                                       const Eigen::Vector2d& pixel,
                                                       double sigma_px, const PlaneFrame& frame)
    : frame_(frame), reprojection_(model, pixel, sigma_px) {
  set_num_residuals(2);
  *mutable_parameter_block_sizes() = {7, 2, 4, CameraModelNumParams(model)};
}

bool ExactPlaneReprojectionCost::Evaluate(double const* const* parameters, double* residuals,
                                          double** jacobians) const {
  Eigen::Vector3d point;
  Eigen::Matrix<double, 3, 2> by_coordinates;
  Eigen::Matrix<double, 3, 4> by_plane;
  if (!PointInPlane(frame_, parameters[2], parameters[1], &point, &by_coordinates, &by_plane)) {
    return false;
  }
  const double* of_point[] = {parameters[0], point.data(), parameters[3]};
  if (jacobians == nullptr) return reprojection_.Evaluate(of_point, residuals, nullptr);
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point;
  double* wanted[] = {jacobians[0], by_point.data(), jacobians[3]};
  if (!reprojection_.Evaluate(of_point, residuals, wanted)) return false;
  using Matrix22 = Eigen::Matrix<double, 2, 2, Eigen::RowMajor>;
  using Matrix24 = Eigen::Matrix<double, 2, 4, Eigen::RowMajor>;
  if (jacobians[1] != nullptr) Eigen::Map<Matrix22>{jacobians[1]} = by_point * by_coordinates;
  if (jacobians[2] != nullptr) Eigen::Map<Matrix24>{jacobians[2]} = by_point * by_plane;
  return true;
}

}  // namespace s3lam
