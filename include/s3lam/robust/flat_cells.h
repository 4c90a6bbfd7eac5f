#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "s3lam/robust/plane_fit.h"

namespace s3lam {

struct FlatCellOptions {
  int min_points = 10;
  double max_sigmas = 3.0;

  void Visit(OptionVisitor& v);
};

/// Tells which parts of a surface lie on a plane. A neighbour that stands a little back is within
/// the uncertainty of each of its points, but not of all of them together, and its many points pull
/// with one accord. So the surface is cut into cells of min_points or more along its two directions
/// (halves, in turn), and a cell whose weighted median distance is more than max_sigmas of that
/// median's own standard deviation off the plane does not lie on it, with all its points. Returns
/// for every point 1 if its cell lies on the plane.
std::vector<uint8_t> FlatCells(const FlatCellOptions& options,
                               std::span<const UncertainPoint> points, const Plane& plane);

}  // namespace s3lam
