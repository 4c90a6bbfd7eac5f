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

/// The distance of a point to its plane in sigmas of its prediction, if the plane did not pull.
inline double Innovation(double distance, double triangulation_variance, double sigma) {
  return std::abs(distance) / std::sqrt(triangulation_variance + sigma * sigma);
}

/// The distance that a member would have without its plane, which pulled it closer by
/// sigma^2 / (s^2 w + sigma^2), with s from triangulation and w the weight that Huber's loss beyond
/// `huber_plane` sigmas (BundleSolverOptions) gave it [map units].
inline double FreeDistance(double distance, double triangulation_variance, double sigma,
                           double huber_plane) {
  const double variance = sigma * sigma;
  const double pulled = std::abs(distance);
  const double weight = std::min(1.0, huber_plane * sigma / std::max(pulled, 1e-300));
  return pulled * ((triangulation_variance * weight + variance) / variance);
}

}  // namespace s3lam
