#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "s3lam/report/drawing.h"

namespace s3lam {

/// What all plots have around them.
struct PlotStyle {
  int width = 620;  // px
  int height = 400;
  std::string title;
  std::string x_label;
  std::string y_label;
};

/// A curve, or the values of a histogram, and what it is called.
struct Series {
  std::string name;
  std::vector<Eigen::Vector2d> points;
};

/// Curves over a common x axis; the y axis begins at zero.
Drawing PlotCurves(const PlotStyle& style, const std::vector<Series>& series);

struct ValueSeries {
  std::string name;
  std::vector<double> values;  // Not negative.
};

/// How many values fall into each of `num_bins` equal bins from 0 to the 99th percentile of all
/// series together; larger values are counted in the last bin.
Drawing PlotHistogram(const PlotStyle& style, const std::vector<ValueSeries>& series, int num_bins);

/// A line through positions, each coloured by its error.
struct ErrorPath {
  std::vector<Eigen::Vector2d> positions;
  std::vector<double> errors;  // One per position.
};

/// A path over the true one (thin), both axes in the same scale, with a scale of colours up to
/// `max_error`.
Drawing PlotErrorPath(const PlotStyle& style, const ErrorPath& path,
                      const std::vector<Eigen::Vector2d>& truth, double max_error);

/// Round values that divide an interval into at most about `count` steps; ascending, within it.
std::vector<double> AxisTicks(double min, double max, int count);

}  // namespace s3lam
