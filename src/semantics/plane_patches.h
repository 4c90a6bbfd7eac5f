#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "s3lam/robust/plane_fit.h"

namespace s3lam {

/// The largest set of inliers that hangs together in the plane: cells of a grid of `max_gap` that
/// touch. Ascending.
std::vector<size_t> LargestPatch(std::span<const UncertainPoint> points, const PlaneFit& fit,
                                 double max_gap);

/// The plane through both sets of inliers, if the two are one surface within their noise: normals
/// within `max_angle` [rad], and the joint inliers scatter by less than `max_sigmas` of their own
/// standard deviations. Indices refer to `points`.
std::optional<PlaneFit> JoinPlanes(std::span<const UncertainPoint> points, const PlaneFit& a,
                                   const PlaneFit& b, double max_angle, double max_sigmas);

}  // namespace s3lam
