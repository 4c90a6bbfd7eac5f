#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "s3lam/geometry/similarity3.h"
#include "s3lam/optim/bundle_adjustment.h"

namespace s3lam {

/// One place in reality as two cameras know it, each with a map point of its own.
struct PointPair {
  Eigen::Vector3d in_a = Eigen::Vector3d::Zero();  // Camera coordinates, in the scale of a's map.
  Eigen::Vector3d in_b = Eigen::Vector3d::Zero();
  Eigen::Vector2d xy_a = Eigen::Vector2d::Zero();  // px, undistorted
  Eigen::Vector2d xy_b = Eigen::Vector2d::Zero();
  double inverse_sigma_a = 1.0;  // 1/px
  double inverse_sigma_b = 1.0;
};

/// Squared reprojection error, in sigma, of the pair's points in each other's cameras, the larger
/// of the two; infinity from behind.
double SquaredPairError(const PinholeIntrinsics& camera, const Similarity3& a_from_b,
                        const PointPair& pair);

struct SimilarityFit {
  Similarity3 a_from_b;         // Camera a from camera b.
  std::vector<size_t> inliers;  // Ascending.
};

/// Robust estimate from pairs of which many may be wrong: three-point samples (Umeyama) inside
/// RANSAC, refined on the reprojection errors of the inliers. Empty if it finds fewer than
/// `min_inliers`.
std::optional<SimilarityFit> EstimateSimilarity(const PinholeIntrinsics& camera,
                                                const std::vector<PointPair>& pairs,
                                                size_t min_inliers, uint64_t seed);

/// Gauss-Newton on the reprojection errors of these pairs, with Huber's weights.
std::optional<Similarity3> RefineSimilarity(const PinholeIntrinsics& camera,
                                            const std::vector<PointPair>& pairs,
                                            std::span<const size_t> used,
                                            const Similarity3& a_from_b);

}  // namespace s3lam
