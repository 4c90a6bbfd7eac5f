#pragma once

#include <cmath>

namespace s3lam {

/// rho(s) of Huber's loss, of a squared residual.
inline double Huber(double squared, double threshold) {
  if (squared <= threshold * threshold) return squared;
  return 2.0 * threshold * std::sqrt(squared) - threshold * threshold;
}

}  // namespace s3lam
