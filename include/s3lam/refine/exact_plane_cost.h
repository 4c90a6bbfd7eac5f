#pragma once

#include <ceres/cost_function.h>

#include <Eigen/Core>

#include "s3lam/geometry/camera.h"
#include "s3lam/refine/bundle_problem.h"
#include "s3lam/refine/cost_functions.h"

namespace s3lam {

/// Axes in which the points of a plane have two coordinates: those of the plane as it is when a
/// solve begins. They stay while the plane moves.
struct PlaneFrame {
  Eigen::Vector3d anchor_in_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d e1 = Eigen::Vector3d::UnitX();
  Eigen::Vector3d e2 = Eigen::Vector3d::UnitY();
  Eigen::Vector3d e3 = Eigen::Vector3d::UnitZ();

  static PlaneFrame Of(const AnchoredPlane& plane);
  [[nodiscard]] Eigen::Vector2d Coordinates(const Eigen::Vector3d& point_in_world) const {
    const Eigen::Vector3d arm = point_in_world - anchor_in_world;
    return {e1.dot(arm), e2.dot(arm)};
  }
};

/// The point of a plane (n, h) with given coordinates: a + u e1 + v e2 + s e3 with
///   n . (u e1 + v e2 + s e3) + h = 0,   so   s = -(n . (u e1 + v e2) + h) / (n . e3).
/// Fills the derivatives by (u, v) and (n, h) that are asked for. False if the plane has turned so
/// far from the frame that it has no such point.
bool PointInPlane(const PlaneFrame& frame, const double* plane, const double* coordinates,
                  Eigen::Vector3d* point_in_world,
                  Eigen::Matrix<double, 3, 2>* by_coordinates = nullptr,
                  Eigen::Matrix<double, 3, 4>* by_plane = nullptr);

/// r = (proj(K, R X + t) - x) / sigma for a point X that lies exactly on a plane.
/// Blocks: pose (7, PoseManifold), coordinates in the plane (2), plane (4, AnchoredPlaneManifold),
/// camera parameters.
class ExactPlaneReprojectionCost : public ceres::CostFunction {
 public:
  ExactPlaneReprojectionCost(CameraModel model, const Eigen::Vector2d& pixel, double sigma_px,
                             const PlaneFrame& frame);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  PlaneFrame frame_;
  ReprojectionCost reprojection_;
};

}  // namespace s3lam
