#pragma once

#include <algorithm>
#include <cmath>

#include "s3lam/refine/plane_model.h"

namespace s3lam {

/// Of a point to its plane, signed [map units].
inline double Distance(const BundleProblem& problem, int plane, int point) {
  const AnchoredPlane& p = problem.planes[plane];
  return p.parameters.head<3>().dot(problem.points[point] - p.anchor_in_world) + p.parameters[3];
}

/// Variance of a point's triangulation along its plane's normal.
inline double NormalVariance(const PlaneModel& model, const BundleProblem& problem, int plane,
                             int point) {
  const Eigen::Vector3d normal = problem.planes[plane].parameters.head<3>();
  return std::max(0.0, normal.dot(model.covariances[point] * normal));
}

/// The unbiased (free) distance of a point in sigmas of its prediction. A member was pulled towards
/// its plane by sigma^2 / (s^2 w + sigma^2), with s from triangulation and w Huber's weight.
inline double Innovation(double distance, double triangulation_variance, double sigma,
                         bool is_member) {
  const double variance = sigma * sigma;
  constexpr double kHuberPlane = 1.96;
  double free_distance = std::abs(distance);
  if (is_member) {
    const double weight = std::min(1.0, kHuberPlane * sigma / std::max(free_distance, 1e-300));
    free_distance *= (triangulation_variance * weight + variance) / variance;
  }
  return free_distance / std::sqrt(triangulation_variance + variance);
}

}  // namespace s3lam
