#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/geometry/rigid3.h"

namespace s3lam {

/// Undistorted pinhole camera [px].
struct PinholeIntrinsics {
  double fx = 1.0;
  double fy = 1.0;
  double cx = 0.0;
  double cy = 0.0;

  /// Pixel of a point in camera coordinates; the caller has checked z > 0.
  [[nodiscard]] Eigen::Vector2d Project(const Eigen::Vector3d& x) const {
    return {fx * x.x() / x.z() + cx, fy * x.y() / x.z() + cy};
  }
  /// Derivative of Project.
  [[nodiscard]] Eigen::Matrix<double, 2, 3> ProjectionJacobian(const Eigen::Vector3d& x) const {
    const double inverse_z = 1.0 / x.z();
    Eigen::Matrix<double, 2, 3> jacobian;
    jacobian << fx * inverse_z, 0.0, -fx * x.x() * inverse_z * inverse_z, 0.0, fy * inverse_z,
        -fy * x.y() * inverse_z * inverse_z;
    return jacobian;
  }
  /// Normalised coordinates of a pixel.
  [[nodiscard]] Eigen::Vector2d Normalize(const Eigen::Vector2d& xy) const {
    return {(xy.x() - cx) / fx, (xy.y() - cy) / fy};
  }
};

/// One keypoint that sees one point.
struct BaObservation {
  int pose = 0;                                  // Index into BaProblem::poses.
  int point = 0;                                 // Index into BaProblem::points.
  Eigen::Vector2d xy = Eigen::Vector2d::Zero();  // px, undistorted
  double inverse_sigma = 1.0;                    // 1/px
};

/// Poses and points seen by one undistorted camera. Fixed poses hold the gauge.
struct BaProblem {
  PinholeIntrinsics camera;
  std::vector<Rigid3> poses;  // cam_from_world
  std::vector<uint8_t> pose_is_fixed;
  std::vector<Eigen::Vector3d> points;  // in world
  /// Grouped by point, points ascending.
  std::vector<BaObservation> observations;
};

struct BundleAdjustmentOptions {
  int max_iterations = 10;
  double huber_sigma = 2.4477;          // sqrt(5.991): 95 % of chi-squared with 2 dof
  double min_relative_decrease = 1e-5;  // of the cost, to go on
  int num_threads = 1;

  void Visit(OptionVisitor& v);
};

struct BundleAdjustmentReport {
  double initial_cost = 0.0;  // 1/2 sum rho
  double final_cost = 0.0;
  int num_iterations = 0;
  bool usable = false;  // Costs are finite and did not rise.
};

/// Minimises sum rho(|| inverse_sigma (project(pose * point) - xy) ||) over free poses and points
/// by Levenberg-Marquardt with points eliminated (Schur complement). An observation from behind its
/// camera has a constant cost and no gradient; a step that puts points behind is rejected by it.
///
/// This exists beside Ceres because the SLAM pass solves many small problems: no problem set-up,
/// and the same bytes at any number of threads (sums are made over fixed chunks in a fixed order).
BundleAdjustmentReport AdjustBundle(const BundleAdjustmentOptions& options, BaProblem& problem);

/// Reprojection error in units of sigma, squared; infinity from behind.
double SquaredError(const PinholeIntrinsics& camera, const Rigid3& cam_from_world,
                    const Eigen::Vector3d& point, const Eigen::Vector2d& xy, double inverse_sigma);

}  // namespace s3lam
