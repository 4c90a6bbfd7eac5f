#include "s3lam/base/statistics.h"

#include <algorithm>
#include <cmath>

namespace s3lam {

double UpperQuantile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto place =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

double MedianStep(const std::vector<double>& values) {
  std::vector<double> steps;
  for (size_t i = 1; i < values.size(); ++i) steps.push_back(values[i] - values[i - 1]);
  return Median(std::move(steps));
}

double InterpolatedMedian(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

double RootMeanSquare(const std::vector<double>& values) {
  if (values.empty()) return 0.0;
  double sum = 0.0;
  for (const double value : values) sum += value * value;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

double RayleighQuantile(double share) { return std::sqrt(-2.0 * std::log(1.0 - share)); }

double ResidualCorrection(size_t track_length) {
  const double residuals = 2.0 * static_cast<double>(track_length);
  return std::sqrt(residuals / (residuals - 3.0));
}

}  // namespace s3lam
