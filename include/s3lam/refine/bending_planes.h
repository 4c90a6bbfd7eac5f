#pragma once

#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/refine/plane_model.h"

namespace s3lam {

/// Surfaces that are flat where one stands and bend over a distance: streets and open ground. One
/// plane over all of such a surface would bend the map instead, with the weight of all its points.
struct BendingOptions {
  std::vector<std::string> classes{"road",       "sidewalk", "terrain",  "pavement-merged",
                                   "railroad",   "gravel",   "platform", "grass-merged",
                                   "dirt-merged"};
  double length_depths = 1.5;
  double max_bend_deg = 1.0;
  double max_step_sigma = 3.0;

  void Visit(OptionVisitor& v);
};

/// Cuts planes of these classes along their length into pieces of length_depths times the median
/// distance from which their points are seen, and ties each piece to the next (a bend of
/// max_bend_deg and a step of max_step_sigma pixels at that distance, one sigma). Pieces keep the
/// plane they come from as a start; the first keeps its id, the others get new ones.
void CutBendingPlanes(const BendingOptions& options, const ClassTable& classes, double sigma_px,
                      PlaneModel& model, BundleProblem& problem);

}  // namespace s3lam
