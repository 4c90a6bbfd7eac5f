#pragma once

#include <Eigen/Core>
#include <cmath>
#include <nlohmann/json.hpp>

#include "s3lam/base/error.h"
#include "s3lam/geometry/plane.h"

namespace s3lam {

/// Throws nlohmann::json::exception, as the others here do, where it is no list of at least three numbers.
inline Eigen::Vector3d VectorFromJson(const nlohmann::json& list) {
  Eigen::Vector3d vector;
  for (int i = 0; i < 3; ++i) vector[i] = list.at(static_cast<size_t>(i)).get<double>();
  return vector;
}

/// Rounding in a file may take the normal from unit length a little: it is scaled to it. Throws
/// InputError for others.
inline Plane PlaneFromJson(const nlohmann::json& normal, double offset) {
  constexpr double kNormTolerance = 1e-3;
  Plane plane{VectorFromJson(normal), offset};
  const double norm = plane.normal.norm();
  if (!(std::abs(norm - 1.0) < kNormTolerance)) throw InputError("the normal is no unit vector");
  plane.normal /= norm;
  plane.offset /= norm;
  return plane;
}

}  // namespace s3lam
