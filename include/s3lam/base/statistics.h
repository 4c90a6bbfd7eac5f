#pragma once

#include <cstddef>
#include <utility>
#include <vector>

namespace s3lam {

/// The value that a share of the others, 0 to below 1, is below; zero for no values.
double UpperQuantile(std::vector<double> values, double share);

/// The upper median; zero for no values.
inline double Median(std::vector<double> values) { return UpperQuantile(std::move(values), 0.5); }

/// The median of the differences of successive values; zero for fewer than two.
double MedianStep(const std::vector<double>& values);

/// The median, of an even number of values the mean of the two middle ones; zero for no values. For
/// what people read; estimators take the upper one.
double InterpolatedMedian(std::vector<double> values);

/// Zero for no values.
double RootMeanSquare(const std::vector<double>& values);

/// The median of the absolute value of a normal variable with a sigma of one.
inline constexpr double kMedianOfAbsoluteNormal = 0.6744897501960817;

/// sqrt(2 ln 2): the median length of a two-dimensional normal vector with a sigma of one.
inline constexpr double kMedianOfRayleigh = 1.1774100225154747;

/// The quantile of the length of such a vector.
double RayleighQuantile(double share);

/// What the length of a residual is multiplied by to undo that its point was fitted to it: a point
/// takes up 3 freedoms of the 2 n residuals of its track. n of two or more.
double ResidualCorrection(size_t track_length);

}  // namespace s3lam
