#include "s3lam/refine/structure_terms.h"

#include "s3lam/refine/cost_functions.h"
#include "s3lam/refine/pose_prior_cost.h"

namespace s3lam {
namespace {

using Kind = StructureBlock::Kind;

void AddRelation(const BundleProblem& problem, const RelationTerm& term,
                 std::vector<StructureTerm>& terms) {
  const auto add = [&](std::unique_ptr<ceres::CostFunction> cost) {
    terms.push_back({std::move(cost),
                     {{Kind::kPlane, term.plane_a}, {Kind::kPlane, term.plane_b}},
                     StructureTerm::Loss::kPlane});
  };
  if (term.relation == PlaneRelation::kOrthogonal) {
    add(std::make_unique<OrthogonalPlanesCost>(term.sigma_rad));
    return;
  }
  add(std::make_unique<ParallelPlanesCost>(term.sigma_rad));
  if (term.relation == PlaneRelation::kParallel) return;
  const AnchoredPlane& a = problem.planes[term.plane_a];
  const AnchoredPlane& b = problem.planes[term.plane_b];
  const bool opposite = a.parameters.head<3>().dot(b.parameters.head<3>()) < 0.0;
  add(std::make_unique<PlanesMeetCost>(term.place_in_world - a.anchor_in_world,
                                       term.place_in_world - b.anchor_in_world, opposite,
                                       term.distance, term.sigma_offset));
}

}  // namespace

std::vector<StructureTerm> MakeStructureTerms(const BundleProblem& problem,
                                              const std::vector<uint8_t>& pose_is_used) {
  std::vector<StructureTerm> terms;
  for (const RelationTerm& term : problem.relations) AddRelation(problem, term, terms);
  for (const HeightTerm& term : problem.heights) {
    if (pose_is_used[term.pose] == 0) continue;
    terms.push_back({std::make_unique<CameraHeightCost>(problem.planes[term.plane].anchor_in_world,
                                                        term.sigma_relative),
                     {{Kind::kPose, term.pose}, {Kind::kPlane, term.plane}, {Kind::kHeight, 0}},
                     StructureTerm::Loss::kPlane});
  }
  for (const PosePriorTerm& term : problem.pose_priors) {
    if (pose_is_used[term.pose] == 0) continue;
    terms.push_back({std::make_unique<PosePriorCost>(term.cam_from_world, term.sigma_position,
                                                     term.sigma_rotation),
                     {{Kind::kPose, term.pose}},
                     StructureTerm::Loss::kReprojection});
  }
  return terms;
}

}  // namespace s3lam
