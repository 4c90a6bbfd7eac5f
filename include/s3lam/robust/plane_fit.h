#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>
#include <span>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/base/rng.h"
#include "s3lam/geometry/plane.h"
#include "s3lam/robust/ransac.h"

namespace s3lam {

/// A point with its uncertainty: what a plane through it may miss it by is
/// sigma^2 = n^T covariance n + roughness^2.
struct UncertainPoint {
  Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
  /// How far the surface itself may depart from a plane [units of the points].
  double roughness = 0.0;
};

struct PlaneFitOptions {
  /// Of a rough surface no sample gives quite the best plane: with one refined alone, or fewer
  /// drawn, the result is left to chance.
  RansacOptions ransac{.min_iterations = 300, .refined_samples = 6};
  double inlier_sigmas = 1.96;
  double local_radius = 0.3;
  double max_tilt_sigma_deg = 3.0;
  double min_width_ratio = 1e-4;

  void Visit(OptionVisitor& v) {
    v.Group("ransac", ransac, "Sampling.");
    v.Value("inlier_sigmas", inlier_sigmas,
            "Largest distance of an inlier, in its own standard deviations (1.96: 95 %).", 0.1);
    v.Value("local_radius", local_radius,
            "Half of the samples are drawn within this fraction of the points' spread.", 0.01);
    v.Value("max_tilt_sigma_deg", max_tilt_sigma_deg,
            "A plane whose normal is less certain than this is refused [deg].", 0.0, 90.0);
    v.Value("min_width_ratio", min_width_ratio,
            "Inliers narrower than this fraction of their length are refused as a line.", 0.0, 1.0);
  }
};

/// A plane with what its inliers say of it.
struct PlaneFit {
  Plane plane;
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();  // Weighted by certainty, on the plane.
  Eigen::Vector3d axis_u = Eigen::Vector3d::UnitX();   // In the plane, along the longest extent.
  Eigen::Vector3d axis_v = Eigen::Vector3d::UnitY();   // normal x axis_u.
  double spread_u = 0.0;                               // RMS of the inliers along u, v.
  double spread_v = 0.0;
  double rms = 0.0;        // Of the inliers' distances.
  double rms_sigma = 0.0;  // The same in units of each point's sigma.
  /// Of (rotation about u [rad], rotation about v [rad], shift along the normal at the centroid);
  /// grown by rms_sigma^2 where the inliers scatter more than predicted.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  std::vector<size_t> inliers;  // Ascending.
};

/// Restricts normals to a band about an axis: min_cosine <= |n . axis| <= max_cosine.
struct NormalBand {
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double min_cosine = 0.0;
  double max_cosine = 1.0;

  [[nodiscard]] bool Contains(const Eigen::Vector3d& normal) const {
    const double cosine = std::abs(normal.dot(axis));
    return cosine >= min_cosine && cosine <= max_cosine;
  }
};

/// Variance [squared units of the points] of a point's distance to a plane.
inline double DistanceVariance(const UncertainPoint& point, const Eigen::Vector3d& normal) {
  return std::max(0.0, normal.dot(point.covariance * normal)) + point.roughness * point.roughness;
}

/// Standard deviation [units of the points] of a point's distance to a plane.
inline double DistanceSigma(const UncertainPoint& point, const Eigen::Vector3d& normal) {
  return std::sqrt(DistanceVariance(point, normal));
}

/// Total least squares plane of the chosen points, each weighted by 1 / sigma^2 for the plane's own
/// normal (iterated, since sigma depends on it). Empty for fewer than three points, points on a
/// line or on one spot.
std::optional<PlaneFit> FitPlane(std::span<const UncertainPoint> points,
                                 std::span<const size_t> indices);

/// The plane that most inliers of a fit lie on. What is allowed for roughness also lets in points
/// next to a smooth surface, which pull at a least squares plane: an M-estimate (Tukey's biweight),
/// with roughness cut down to the share, from none to all, that the inliers' median distance shows.
/// The inliers stay; rms, rms_sigma and covariance are theirs, about the new plane and with all of
/// the roughness. The fit as given where the weights leave the plane undetermined.
PlaneFit RefitRobustly(std::span<const UncertainPoint> points, const PlaneFit& fit);

/// The plane that most points support, the closer they are to it the more: Ransac over minimal
/// samples with RansacLoss::kOverScales, then FitPlane on the inliers. Empty if the points are
/// degenerate or no plane has its normal in the band.
std::optional<PlaneFit> FindPlane(std::span<const UncertainPoint> points,
                                  const PlaneFitOptions& options, const NormalBand& band, Rng& rng);

/// True if the inliers tell which way the plane faces: it is less uncertain than
/// max_tilt_sigma_deg, and they are no line, narrower than min_width_ratio allows or no wider than
/// their noise makes one.
bool IsDetermined(std::span<const UncertainPoint> points, const PlaneFit& fit,
                  const PlaneFitOptions& options);

/// FindPlane; empty as well if that plane is not determined.
std::optional<PlaneFit> FitPlaneRobustly(std::span<const UncertainPoint> points,
                                         const PlaneFitOptions& options, const NormalBand& band,
                                         Rng& rng);

}  // namespace s3lam
