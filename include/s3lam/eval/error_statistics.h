#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace s3lam {

/// Of a list of errors; all zero for an empty one.
struct ErrorStatistics {
  size_t count = 0;
  double rmse = 0.0;
  double mean = 0.0;
  double median = 0.0;  // Mean of the middle two for an even count.
  double std = 0.0;     // About the mean, divided by the count.
  double min = 0.0;
  double max = 0.0;
};
ErrorStatistics ComputeErrorStatistics(std::vector<double> errors);

nlohmann::json ToJson(const ErrorStatistics& statistics);

/// One line of a table whose columns are name, rmse, mean, median, min, max.
std::string TableRow(std::string_view name, const ErrorStatistics& statistics);
/// The line above those.
std::string TableHeader();

}  // namespace s3lam
