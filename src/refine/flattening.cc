#include "s3lam/refine/flattening.h"

#include <algorithm>
#include <utility>

namespace s3lam {
namespace {

/// Leaves nothing but the points of a problem free, and what stays out of it as it was afterwards.
class OnlyPointsFree {
 public:
  explicit OnlyPointsFree(BundleProblem& problem)
      : problem_(problem),
        poses_(std::exchange(problem.pose_is_constant,
                             std::vector<uint8_t>(problem.poses.size(), uint8_t{1}))),
        relations_(std::exchange(problem.relations, {})),
        heights_(std::exchange(problem.heights, {})),
        priors_(std::exchange(problem.pose_priors, {})),
        points_on_planes_(problem.points_on_planes) {
    for (AnchoredPlane& plane : problem.planes) {
      planes_.push_back(plane.is_constant);
      plane.is_constant = true;
    }
  }
  ~OnlyPointsFree() {
    problem_.pose_is_constant = std::move(poses_);
    problem_.relations = std::move(relations_);
    problem_.heights = std::move(heights_);
    problem_.pose_priors = std::move(priors_);
    problem_.points_on_planes = std::move(points_on_planes_);
    for (size_t k = 0; k < planes_.size(); ++k) problem_.planes[k].is_constant = planes_[k];
  }
  OnlyPointsFree(const OnlyPointsFree&) = delete;
  OnlyPointsFree& operator=(const OnlyPointsFree&) = delete;

 private:
  BundleProblem& problem_;
  std::vector<uint8_t> poses_;
  std::vector<RelationTerm> relations_;
  std::vector<HeightTerm> heights_;
  std::vector<PosePriorTerm> priors_;
  std::vector<PointOnPlane> points_on_planes_;
  std::vector<bool> planes_;
};

}  // namespace

void FlattenPoints(const BundleSolverOptions& solver, const PlaneSigmaOptions& sigma,
                   const PlaneModel& planes, SolveJournal* journal, BundleProblem& problem) {
  const bool has_free_points =
      std::any_of(problem.points_on_planes.begin(), problem.points_on_planes.end(),
                  [&](const auto& term) { return !problem.IsConstantPoint(term.point); });
  if (sigma.kind != PlaneSigmaKind::kPixel || !has_free_points) return;
  const OnlyPointsFree scope(problem);
  for (PointOnPlane& term : problem.points_on_planes) {
    const double in_common = planes.planes[term.plane].kappa;
    term.sigma = solver.sigma_px * planes.keypoint_size[term.point] / in_common;
  }
  SolveBundle(solver, journal, problem);
}

}  // namespace s3lam
