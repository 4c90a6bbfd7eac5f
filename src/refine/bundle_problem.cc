#include "s3lam/refine/bundle_problem.h"

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

std::vector<uint8_t> BundleProblem::UsedPoses() const {
  std::vector<uint8_t> used(poses.size(), 0);
  for (const BundleObservation& o : observations) used[o.pose] = 1;
  return used;
}

Eigen::Vector3d BundleProblem::CenterOf(int pose) const {
  return FromPoseBlock(poses[pose].data()).CenterInB();
}

}  // namespace s3lam
