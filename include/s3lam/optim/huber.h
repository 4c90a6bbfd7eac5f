#pragma once

#include <cmath>

namespace s3lam {

/// rho(s) of Huber's loss, of a squared residual.
inline double Huber(double squared, double threshold) {
  if (squared <= threshold * threshold) return squared;
  return 2.0 * threshold * std::sqrt(squared) - threshold * threshold;
}

/// sqrt(rho'(s)) of Huber's loss.
inline double HuberWeight(double squared, double threshold) {
  if (squared <= threshold * threshold) return 1.0;
  return std::sqrt(threshold / std::sqrt(squared));
}

}  // namespace s3lam
