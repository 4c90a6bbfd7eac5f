#pragma once

#include <ceres/cost_function.h>

#include <memory>
#include <vector>

#include "s3lam/refine/bundle_problem.h"

namespace s3lam {

/// A parameter block of a BundleProblem that is not a point.
struct StructureBlock {
  enum class Kind { kPose, kPlane, kHeight };
  Kind kind = Kind::kPose;
  int index = 0;
};

/// A cost that touches no point, and the blocks it is evaluated at, in the cost's order.
struct StructureTerm {
  enum class Loss { kNone, kPlane, kReprojection };  // Whose robust loss it is under.
  std::unique_ptr<ceres::CostFunction> cost;
  std::vector<StructureBlock> blocks;
  Loss loss = Loss::kPlane;
};

/// Relations between planes; heights of cameras and pose priors, of poses that are in use.
std::vector<StructureTerm> MakeStructureTerms(const BundleProblem& problem,
                                              const std::vector<uint8_t>& pose_is_used);

}  // namespace s3lam
