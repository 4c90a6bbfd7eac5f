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

/// A surface known with less certainty than its points claim, with those of the `free` points that
/// lie within `max_sigmas` of its own scatter over its outline; the fit itself if that fails.
PlaneFit GatherPoints(std::span<const UncertainPoint> points, std::span<const size_t> free,
                      PlaneFit fit, double max_sigmas);

/// When two patches are one surface: normals within `max_angle` [rad], and the joint inliers
/// scatter by less than `max_sigmas` of their own standard deviations.
struct JoinLimits {
  double max_angle = 0.0;
  double max_sigmas = 0.0;
};

/// The plane through both sets of inliers, if the two are one surface. Where one lies over the
/// other, `layered` decides in place of `apart`: of two opaque surfaces the cameras would see one
/// only, so nearly parallel layers are one surface whose points are less certain than they claim.
/// Indices refer to `points`.
std::optional<PlaneFit> JoinPlanes(std::span<const UncertainPoint> points, const PlaneFit& a,
                                   const PlaneFit& b, const JoinLimits& apart,
                                   const JoinLimits& layered);

}  // namespace s3lam
