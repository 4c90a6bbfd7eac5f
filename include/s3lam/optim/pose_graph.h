#pragma once

#include <vector>

#include "s3lam/geometry/similarity3.h"

namespace s3lam {

/// Two nodes and the measured similarity between them.
struct PoseGraphEdge {
  int a = 0;  // Index into PoseGraph::nodes.
  int b = 0;
  Similarity3 a_from_b;
  double length = 1.0;  // Of which a translation error is measured in shares [units of node a].
  double weight = 1.0;
};

/// Cameras that may each have a scale of their own, and measurements between them.
struct PoseGraph {
  std::vector<Similarity3> nodes;  // cam_from_world
  int fixed = 0;                   // The node that holds the gauge.
  std::vector<PoseGraphEdge> edges;
};

struct PoseGraphReport {
  double initial_cost = 0.0;
  double final_cost = 0.0;
  bool usable = false;
};

/// Minimises sum weight^2 || e(a_from_b^-1 * (node_a * node_b^-1)) ||^2 over the nodes, with
/// e = (rotation vector [rad], translation / length, log scale), so that the drift around a loop,
/// of scale too (Strasdat et al. 2010), spreads over its edges.
PoseGraphReport OptimizePoseGraph(PoseGraph& graph);

}  // namespace s3lam
