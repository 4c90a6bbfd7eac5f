#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "s3lam/geometry/rigid3.h"

namespace s3lam {

/// Candidates for the motion between two calibrated views from matched normalised coordinates: the
/// decompositions of the essential matrix and of the homography that fit best (OpenCV's USAC, whose
/// own seed is fixed: `seed` is that of the order in which it gets the matches). `threshold` is in
/// normalised units; translations have norm 1. Which candidate is right (cheirality, planar
/// ambiguity) is for the caller to decide. Empty when neither model fits.
std::vector<Rigid3> RelativePoseCandidates(std::span<const Eigen::Vector2d> normalized_a,
                                           std::span<const Eigen::Vector2d> normalized_b,
                                           double threshold, uint64_t seed);

}  // namespace s3lam
