#include "s3lam/base/statistics.h"

#include <cmath>

namespace s3lam {

double ResidualCorrection(size_t track_length) {
  const double residuals = 2.0 * static_cast<double>(track_length);
  return std::sqrt(residuals / (residuals - 3.0));
}

}  // namespace s3lam
