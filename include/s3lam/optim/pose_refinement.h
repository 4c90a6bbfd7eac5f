#pragma once

#include <Eigen/Core>
#include <vector>

#include "s3lam/optim/bundle_adjustment.h"

namespace s3lam {

/// A keypoint and the known point it sees.
struct PoseObservation {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  Eigen::Vector2d xy = Eigen::Vector2d::Zero();  // px, undistorted
  double inverse_sigma = 1.0;                    // 1/px
};

struct PoseRefinementResult {
  std::vector<uint8_t> is_inlier;  // Per observation: squared error at most 5.991 sigma^2.
  int num_inliers = 0;
  /// Inverse covariance of (omega, tau), R <- exp(omega) R, t <- t + tau, from the inliers.
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
};

/// Refines one pose against fixed points: a few rounds of Gauss-Newton with Huber's weights, the
/// inliers chosen anew between rounds (as in ORB-SLAM's motion-only bundle adjustment).
PoseRefinementResult RefinePose(const PinholeIntrinsics& camera,
                                const std::vector<PoseObservation>& observations,
                                Rigid3& cam_from_world);

}  // namespace s3lam
