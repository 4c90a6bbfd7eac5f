#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "s3lam/geometry/similarity3.h"

namespace s3lam {

/// The similarity (or, with `with_scale` false, rigid transform of scale 1) that minimises
/// sum_i || a_i - a_from_b * b_i ||^2 in closed form (Umeyama 1991). Empty for fewer than three
/// pairs or points that leave the rotation undetermined (all on one spot or line).
std::optional<Similarity3> AlignPoints(std::span<const Eigen::Vector3d> points_in_a,
                                       std::span<const Eigen::Vector3d> points_in_b,
                                       bool with_scale = true);

}  // namespace s3lam
