#include "s3lam/eval/error_statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace s3lam {

ErrorStatistics ComputeErrorStatistics(std::vector<double> errors) {
  ErrorStatistics statistics;
  if (errors.empty()) return statistics;
  std::sort(errors.begin(), errors.end());
  const auto count = static_cast<double>(errors.size());
  double sum = 0.0;
  double sum_squared = 0.0;
  for (const double error : errors) {
    sum += error;
    sum_squared += error * error;
  }
  statistics.count = errors.size();
  statistics.mean = sum / count;
  statistics.rmse = std::sqrt(sum_squared / count);
  double squared_deviations = 0.0;
  for (const double error : errors) {
    squared_deviations += (error - statistics.mean) * (error - statistics.mean);
  }
  statistics.std = std::sqrt(squared_deviations / count);
  const size_t middle = errors.size() / 2;
  statistics.median =
      errors.size() % 2 == 1 ? errors[middle] : 0.5 * (errors[middle - 1] + errors[middle]);
  statistics.min = errors.front();
  statistics.max = errors.back();
  return statistics;
}

nlohmann::json ToJson(const ErrorStatistics& statistics) {
  return {{"count", statistics.count},   {"rmse", statistics.rmse}, {"mean", statistics.mean},
          {"median", statistics.median}, {"std", statistics.std},   {"min", statistics.min},
          {"max", statistics.max}};
}

std::string TableRow(std::string_view name, const ErrorStatistics& statistics) {
  return fmt::format("{:<22} {:>11.6f} {:>11.6f} {:>11.6f} {:>11.6f} {:>11.6f}\n", name,
                     statistics.rmse, statistics.mean, statistics.median, statistics.min,
                     statistics.max);
}

std::string TableHeader() {
  return fmt::format("{:<22}{:>12}{:>12}{:>12}{:>12}{:>12}\n", "", "rmse", "mean", "median", "min",
                     "max");
}

}  // namespace s3lam
