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

/// True if a plane of their own for each of two sets of inliers of `joint` explains them better
/// than that one plane does: F-test of its three parameters, by the points' own scatter.
bool AreTwoSurfaces(const PlaneFit& joint, const PlaneFit& a, const PlaneFit& b);

/// Two surfaces with room between them may nearly line up, as houses along a street do: a plane
/// through parts of both is neither's. Where the inliers leave a gap across the plane and the parts
/// on either side are two surfaces, the larger part is kept, as often as that happens. Parts of
/// fewer than `min_points` say nothing.
PlaneFit SplitAtGaps(std::span<const UncertainPoint> points, PlaneFit fit, size_t min_points);

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
