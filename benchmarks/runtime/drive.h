#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "s3lam/refine/bundle_problem.h"
#include "s3lam/scene/reconstruction.h"

namespace s3lam::benchmarks {

/// A drive along a street that closes in a ring and is driven twice, one keyframe per metre: what a
/// long map of a vehicle looks like to bundle adjustment, in any size. Facades are flat for 20 m,
/// the ground for 40 m.
struct Drive {
  Reconstruction model;
  std::vector<AnchoredPlane> planes;
  std::map<PointId, int> plane_of_point;  // Of the 60 % that lie on one.
};

/// About five observations of each point, keypoints with 0.5 px of noise.
Drive MakeDrive(int num_keyframes, int points_per_keyframe, uint64_t seed);

/// Moves points and camera centres by 1 % of the median depth and turns cameras by 0.3 deg
/// (standard deviations).
void Perturb(uint64_t seed, Reconstruction& model);

}  // namespace s3lam::benchmarks
