#include "s3lam/refine/bundle_problem.h"

#include <algorithm>

namespace s3lam {

Plane AnchoredPlane::PlaneInWorld() const {
  const Eigen::Vector3d normal = parameters.head<3>();
  return {normal, parameters[3] - normal.dot(anchor_in_world)};
}

AnchoredPlane AnchoredPlane::FromPlane(const Plane& plane_in_world, const Eigen::Vector3d& anchor) {
  AnchoredPlane plane;
  plane.parameters << plane_in_world.normal, plane_in_world.SignedDistance(anchor);
  plane.anchor_in_world = anchor;
  return plane;
}

bool BundleProblem::HasSpecialTerms() const {
  const auto is_set = [](uint8_t flag) { return flag != 0; };
  return !pose_priors.empty() ||
         std::any_of(point_is_constant.begin(), point_is_constant.end(), is_set) ||
         std::any_of(free_camera_params.begin(), free_camera_params.end(),
                     [](const std::vector<int>& free) { return !free.empty(); }) ||
         std::any_of(points_on_planes.begin(), points_on_planes.end(),
                     [](const PointOnPlane& term) { return term.is_exact; });
}

}  // namespace s3lam
