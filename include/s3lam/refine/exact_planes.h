#pragma once

#include <cstdint>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/refine/plane_model.h"

namespace s3lam {

/// When a plane is so certain that its points are put onto it (mode hard).
struct ExactPlaneOptions {
  int min_points = 50;
  double min_member_share = 0.8;
  double max_scatter = 1.5;
  double max_point_sigma = 3.0;

  void Visit(OptionVisitor& v);
};

/// Which planes have their points exactly on them, and which points may not be among these.
struct ExactPlanes {
  std::vector<uint8_t> is_exact;        // Per plane; empty until they are chosen.
  std::vector<uint8_t> point_is_freed;  // Per point.
  size_t num_points = 0;                // On exact planes at present.
};

/// After AssignPoints: the first time, chooses the planes with overwhelming evidence, i.e. at least
/// min_points members that are min_member_share of the candidates and whose distances, which no
/// plane has pulled at yet, scatter by at most max_scatter of what triangulation alone explains.
/// Ground and pieces of bending surfaces are not among them. From then on frees every point that
/// its observations would take off its plane by more than max_point_sigma. Marks the terms of what
/// is left as exact.
void MarkExactPlanes(const ExactPlaneOptions& options, double sigma_px, const PlaneModel& model,
                     ExactPlanes& exact, BundleProblem& problem);

/// How far along `normal` each point would go, by one Gauss-Newton step on its reprojection errors
/// with the poses held, in standard deviations of that step; zero for points not in use.
std::vector<double> StepsOffPlanes(const BundleProblem& problem, double sigma_px,
                                   const std::vector<int>& plane_of_point);

}  // namespace s3lam
