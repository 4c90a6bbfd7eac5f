#pragma once

#include <ceres/cost_function.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>

#include "s3lam/geometry/camera.h"

namespace s3lam {

/// A point behind a camera: there every cost function of a projection reports failure, which the
/// solver answers by refusing the step. It never yields a zero residual. Whoever builds a problem
/// leaves out observations that are behind at the start.

/// r = (proj(K, R X + t) - x) / sigma, two residuals [sigma].
/// Blocks: pose (7 numbers, PoseManifold), point in world (3), camera parameters (as the model
/// has).
class ReprojectionCost : public ceres::CostFunction {
 public:
  /// `pixel` and `sigma_px` in px.
  ReprojectionCost(CameraModel model, const Eigen::Vector2d& pixel, double sigma_px);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector2d pixel_;
  double inverse_sigma_;
  CameraModel model_;
};

/// r = (n . X + d) / sigma for a plane that is held fixed: touches exactly one point, and its
/// Jacobian is the plane's normal (paper, section on map optimisation). Block: point (3).
class PointFixedPlaneCost : public ceres::SizedCostFunction<1, 3> {
 public:
  /// (normal, offset) with a unit normal; sigma in map units.
  PointFixedPlaneCost(const Eigen::Vector4d& plane_in_world, double sigma);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector4d scaled_plane_;  // Divided by sigma.
};

/// r = (n . (X - anchor) + h) / sigma for a plane that is optimised too.
/// Blocks: point (3), plane (4 numbers, AnchoredPlaneManifold).
class PointPlaneCost : public ceres::SizedCostFunction<1, 3, 4> {
 public:
  PointPlaneCost(const Eigen::Vector3d& anchor_in_world, double sigma);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector3d anchor_in_world_;
  double inverse_sigma_;
};

/// r = (h_i / height - 1) / sigma_relative with h_i the distance of a camera centre from the
/// ground: the camera of a vehicle keeps its height, whatever the unit of the map. Fails for a
/// height that is not positive. Blocks: pose (7), ground plane (4), height (1).
class CameraHeightCost : public ceres::SizedCostFunction<1, 7, 4, 1> {
 public:
  /// The plane's normal points to the side the cameras are on.
  CameraHeightCost(const Eigen::Vector3d& anchor_in_world, double sigma_relative);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector3d anchor_in_world_;
  double inverse_sigma_;
};

/// Two planes are parallel: r = n_a x n_b / sigma, three residuals. Blocks: plane (4), plane (4).
class ParallelPlanesCost : public ceres::SizedCostFunction<3, 4, 4> {
 public:
  explicit ParallelPlanesCost(double sigma_rad) : inverse_sigma_(1.0 / sigma_rad) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  double inverse_sigma_;
};

/// Two planes are at right angles: r = n_a . n_b / sigma. Blocks: plane (4), plane (4).
class OrthogonalPlanesCost : public ceres::SizedCostFunction<1, 4, 4> {
 public:
  explicit OrthogonalPlanesCost(double sigma_rad) : inverse_sigma_(1.0 / sigma_rad) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  double inverse_sigma_;
};

/// Two planes meet, or are a step apart, at a place: with d the signed distance to a plane and s =
/// +1 or -1 for normals to the same or to opposite sides, r = (d_a(x) - s d_b(x) - step) / sigma.
/// With ParallelPlanesCost the two are the same plane, or parallel ones at a distance. Blocks:
/// plane a (4), plane b (4).
class PlanesMeetCost : public ceres::SizedCostFunction<1, 4, 4> {
 public:
  /// The place relative to either plane's anchor; step and sigma in map units.
  PlanesMeetCost(const Eigen::Vector3d& arm_a, const Eigen::Vector3d& arm_b, bool opposite,
                 double step, double sigma);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Eigen::Vector3d scaled_arm_a_;
  Eigen::Vector3d scaled_arm_b_;  // With the sign s and divided by sigma.
  double scale_a_;
  double scale_b_;
  double scaled_step_;
};

}  // namespace s3lam
