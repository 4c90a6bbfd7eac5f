#pragma once

#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/refine/plane_model.h"
#include "s3lam/scene/constraints.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// Relations between planes that the geometry itself proposes.
struct RelationOptions {
  bool enabled = true;
  double max_parallel_deg = 4.0;
  double max_orthogonal_deg = 2.0;
  double max_normal_sigma_deg = 1.0;
  double sigma_deg = 0.2;
  double max_offset_sigma = 3.0;
  int max_partners = 3;
  std::vector<std::string> refused;

  void Visit(OptionVisitor& v);
};

/// How far plane a is behind plane b at a place, seen along a's normal, if they are parallel.
double StepBetween(const Plane& a, const Plane& b, const Eigen::Vector3d& place_in_world);

/// Ties planes whose distance is known to it, and to being parallel up to sigma_deg, whatever the
/// options say of relations that are proposed. Throws InputError for planes that the semantic map
/// does not have or that are far from parallel. Planes that have too few points to be used are left
/// out.
void AddKnownDistances(const RelationOptions& options, const std::vector<PlaneDistance>& distances,
                       const SemanticMap& semantics, const PlaneModel& model,
                       BundleProblem& problem);

/// Known distances that no term of the problem stands for: of planes with too few points near them,
/// or of the ground, whose planes make way for those under the cameras.
std::vector<PlaneDistance> UnusedDistances(const std::vector<PlaneDistance>& distances,
                                           const PlaneModel& model, const BundleProblem& problem);

/// Relations between the planes in use (those of the ground apart), on evidence:
///   parallel    within max_parallel_deg and three sigmas of the two normals,
///   orthogonal  within max_orthogonal_deg, closer than for parallel ones because chance brings two
///               planes near to a right angle far more often than near to parallel,
///   coplanar    parallel, of one class, and without a step between them beyond max_offset_sigma of
///               their own uncertainty.
/// A normal less certain than max_normal_sigma_deg says nothing, and nothing is proposed for planes
/// whose distance is known or that are farther from each other than the views of both reach. Every
/// plane gets at most max_partners relations of a kind, with the planes that have the most points.
/// Terms are ordered by planes and robust in the solve.
std::vector<RelationTerm> ProposeRelations(const RelationOptions& options,
                                           const PlaneSigmaOptions& sigma, double sigma_px,
                                           const ClassTable& classes, const PlaneModel& model,
                                           const BundleProblem& problem);

}  // namespace s3lam
