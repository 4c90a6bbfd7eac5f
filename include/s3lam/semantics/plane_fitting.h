#pragma once

#include <optional>

#include "s3lam/base/options.h"
#include "s3lam/robust/plane_fit.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

struct PlaneFittingOptions {
  PlaneFitOptions fit;
  double min_keypoint_sigma_px = 0.5;
  double roughness = 0.004;
  double max_point_sigma = 0.05;
  double max_gap = 0.5;
  double merge_angle_deg = 5.0;
  double merge_sigmas = 2.0;
  double layer_angle_deg = 10.0;
  double layer_sigmas = 4.0;
  double orientation_deg = 15.0;
  double exact_deg = 3.0;
  double exact_share = 0.9;
  int max_planes_per_cluster = 12;
  double min_cluster_share = 0.02;

  void Visit(OptionVisitor& v);
};

/// Standard deviation of a keypoint [px], from the median reprojection error of the model.
double EstimateKeypointSigma(const Reconstruction& reconstruction);

/// Covariance of a point given its cameras' poses: sigma_px^2 (sum_i J_i^T J_i)^-1 over its
/// observations, J_i the pinhole derivative of the pixel by the point. Long along the viewing ray
/// where the parallax is small. Empty if the observations leave the point undetermined.
std::optional<Eigen::Matrix3d> PointCovariance(const Reconstruction& reconstruction,
                                               const ScenePoint& point, double sigma_px);

/// Fits planes to every cluster of a planar class, by RANSAC and weighted least squares, as long as
/// what is left of the cluster supports another with the class's minimum of inliers. What a point
/// may miss a plane by is its covariance along the normal, for keypoints of `keypoint_sigma_px`,
/// and the surface's roughness. A plane is one connected patch; patches that are one within their
/// noise are joined. At last each is moved to where most of its inliers lie (RefitRobustly). Where
/// planes of horizontal classes tell which way is up, classes of a known orientation keep to it,
/// and of planes that fit about equally well the more upright or level one is taken. Normals point
/// to the cameras. Deterministic in the seed, at any number of threads.
void FitPlanes(const Reconstruction& reconstruction, double keypoint_sigma_px,
               const PlaneFittingOptions& options, uint64_t seed, int num_threads,
               SemanticMap& map);

}  // namespace s3lam
