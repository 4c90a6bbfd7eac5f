#pragma once

#include <ceres/sized_cost_function.h>

#include "s3lam/geometry/rigid3.h"

namespace s3lam {

/// A pose known beforehand:
///   r = ((C - C_0) / sigma_position, log(R R_0^T) / sigma_rotation),   C the camera's centre.
/// Block: pose (7 numbers, PoseManifold).
class PosePriorCost : public ceres::SizedCostFunction<6, 7> {
 public:
  /// Sigmas in map units and rad; with a sigma of zero the three residuals are zero (not known).
  PosePriorCost(const Rigid3& cam_from_world, double sigma_position, double sigma_rotation);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Rigid3 cam_from_world_;
  double position_weight_;
  double rotation_weight_;
};

}  // namespace s3lam
