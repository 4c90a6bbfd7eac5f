#pragma once

#include <algorithm>
#include <vector>

namespace s3lam {

/// The upper median; zero for no values.
inline double Median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// sqrt(2 ln 2): the median length of a two-dimensional normal vector with a sigma of one.
inline constexpr double kMedianOfRayleigh = 1.1774100225154747;

/// What the length of a residual is multiplied by to undo that its point was fitted to it: a point
/// takes up 3 freedoms of the 2 n residuals of its track. n of two or more.
double ResidualCorrection(size_t track_length);

}  // namespace s3lam
