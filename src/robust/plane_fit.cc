#include "s3lam/robust/plane_fit.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "s3lam/base/statistics.h"

namespace s3lam {
namespace {

constexpr int kReweightings = 5;

/// Keeps weights finite for points said to be exact.
constexpr double kMinRelativeSigma = 1e-6;

struct WeightedMoments {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();  // Per unit of weight.
};

WeightedMoments ComputeMoments(std::span<const UncertainPoint> points,
                               std::span<const size_t> indices, std::span<const double> weights) {
  WeightedMoments moments;
  double total = 0.0;
  for (size_t k = 0; k < indices.size(); ++k) {
    moments.mean += weights[k] * points[indices[k]].xyz;
    total += weights[k];
  }
  moments.mean /= total;
  for (size_t k = 0; k < indices.size(); ++k) {
    const Eigen::Vector3d d = points[indices[k]].xyz - moments.mean;
    moments.scatter += weights[k] / total * d * d.transpose();
  }
  return moments;
}

/// Plane, axes and spreads from the moments; false for points on a line or spot.
bool PlaneFromMoments(const WeightedMoments& moments, PlaneFit& fit) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(moments.scatter);
  const Eigen::Vector3d values = solver.eigenvalues().cwiseMax(0.0);  // Ascending.
  if (!values.allFinite() || values[2] <= 0.0 || values[1] < 1e-12 * values[2]) return false;
  fit.centroid = moments.mean;
  fit.plane.normal = solver.eigenvectors().col(0).normalized();
  fit.plane.offset = -fit.plane.normal.dot(fit.centroid);
  fit.axis_u = solver.eigenvectors().col(2).normalized();
  fit.axis_v = fit.plane.normal.cross(fit.axis_u);
  fit.spread_u = std::sqrt(values[2]);
  fit.spread_v = std::sqrt(values[1]);
  return true;
}

void ComputeSpreadAndCovariance(std::span<const UncertainPoint> points, double min_sigma,
                                PlaneFit& fit) {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  double squares = 0.0;
  double normalised_squares = 0.0;
  for (const size_t i : fit.inliers) {
    const double distance = fit.plane.SignedDistance(points[i].xyz);
    const double sigma = std::max(min_sigma, DistanceSigma(points[i], fit.plane.normal));
    const Eigen::Vector3d d = points[i].xyz - fit.centroid;
    // d(distance) / d(rotation about u, rotation about v, shift): n' = n - a v + b u.
    const Eigen::Vector3d jacobian(-fit.axis_v.dot(d), fit.axis_u.dot(d), -1.0);
    information += jacobian * jacobian.transpose() / (sigma * sigma);
    squares += distance * distance;
    normalised_squares += distance * distance / (sigma * sigma);
  }
  const auto n = static_cast<double>(fit.inliers.size());
  fit.rms = std::sqrt(squares / n);
  fit.rms_sigma = std::sqrt(normalised_squares / n);
  fit.covariance = std::max(1.0, fit.rms_sigma * fit.rms_sigma) * information.inverse();
}

/// How far an inlier is from a plane, and what explains it.
struct Departure {
  double distance = 0.0;
  double point_variance = 0.0;  // Of the point itself, along the normal.
  double roughness = 0.0;       // Of the surface.

  [[nodiscard]] double Variance(double share) const {
    return point_variance + share * share * roughness * roughness;
  }
};

std::vector<Departure> FindDepartures(std::span<const UncertainPoint> points, const PlaneFit& fit,
                                      double min_sigma) {
  std::vector<Departure> departures;
  for (const size_t i : fit.inliers) {
    const UncertainPoint& point = points[i];
    const double roughness = point.roughness;
    const double variance = DistanceVariance(point, fit.plane.normal) - roughness * roughness;
    departures.push_back({std::abs(fit.plane.SignedDistance(point.xyz)),
                          std::max(variance, min_sigma * min_sigma), roughness});
  }
  return departures;
}

/// Of the distances in units of what explains them. 1 if they scatter as that says.
double RobustScatter(std::span<const Departure> departures, double share) {
  std::vector<double> errors;
  for (const Departure& d : departures) {
    errors.push_back(d.distance / std::sqrt(d.Variance(share)));
  }
  return Median(std::move(errors)) / kMedianOfAbsoluteNormal;
}

/// The share of their roughness, 0 to 1, with which points scatter as they say they do.
double RoughnessShare(std::span<const Departure> departures) {
  constexpr int kHalvings = 10;
  double low = 0.0;
  double high = 1.0;
  for (int i = 0; i < kHalvings; ++i) {
    const double share = 0.5 * (low + high);
    (RobustScatter(departures, share) > 1.0 ? low : high) = share;
  }
  return high;
}

/// Weights of a least squares step towards the plane that most points lie on: Tukey's biweight of
/// their scatter.
std::vector<double> BiweightsOf(std::span<const Departure> departures) {
  constexpr double kWidth = 4.685;  // 95 % as efficient as least squares without any outlier.
  const double share = RoughnessShare(departures);
  const double scatter = std::max(1.0, RobustScatter(departures, share));
  std::vector<double> weights;
  for (const Departure& d : departures) {
    const double variance = d.Variance(share);
    const double ratio = d.distance / (kWidth * scatter * std::sqrt(variance));
    weights.push_back(ratio < 1.0 ? std::pow(1.0 - ratio * ratio, 2) / variance : 0.0);
  }
  return weights;
}

/// True if the inliers may be a line that their noise makes as wide as it is thick: the covariance
/// of the plane, which takes where they lie in it for exact, would not show that.
bool IsWidthNoise(std::span<const UncertainPoint> points, const PlaneFit& fit) {
  constexpr double kMinRatio = 2.0;
  const double min_sigma = kMinRelativeSigma * fit.spread_u;
  double variance = 0.0;
  double total = 0.0;
  for (const size_t i : fit.inliers) {
    const double sigma = std::max(min_sigma, DistanceSigma(points[i], fit.plane.normal));
    variance += fit.axis_v.dot(points[i].covariance * fit.axis_v) / (sigma * sigma);
    total += 1.0 / (sigma * sigma);
  }
  const double noise = std::max(1.0, fit.rms_sigma) * std::sqrt(std::max(0.0, variance / total));
  return fit.spread_v < kMinRatio * std::max(fit.rms, noise);
}

/// Draws, estimates and scores for Ransac.
class PlaneEstimator {
 public:
  using Model = Plane;
  static constexpr size_t kSampleSize = 3;
  /// How smooth a surface is and how certain its points are is not known well: of two planes, that
  /// with points close to it is to be taken, not a tilted one with as many in a wide band.
  static constexpr RansacLoss kLoss = RansacLoss::kOverScales;

  PlaneEstimator(std::span<const UncertainPoint> points, const PlaneFitOptions& options,
                 const NormalBand& band)
      : points_(points), band_(band), squared_threshold_(std::pow(options.inlier_sigmas, 2)) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const UncertainPoint& p : points) mean += p.xyz;
    mean /= static_cast<double>(points.size());
    double squares = 0.0;
    for (const UncertainPoint& p : points) squares += (p.xyz - mean).squaredNorm();
    const double spread = std::sqrt(squares / static_cast<double>(points.size()));
    squared_radius_ = std::pow(options.local_radius * spread, 2);
    min_sigma_ = kMinRelativeSigma * spread;
    for (const UncertainPoint& p : points) {
      const double variance = p.covariance.trace() + p.roughness * p.roughness;
      variance_bounds_.push_back(std::max(variance, min_sigma_ * min_sigma_));
      inlier_bounds_.push_back(squared_threshold_ * variance_bounds_.back());
    }
  }

  [[nodiscard]] size_t size() const { return points_.size(); }
  [[nodiscard]] double min_sigma() const { return min_sigma_; }

  /// A sample whose plane has its normal in the band, if one is found soon: a draw costs little,
  /// and a narrow band refuses most planes through three points of a rough surface.
  [[nodiscard]] std::array<size_t, 3> DrawSample(Rng& rng) const {
    constexpr int kTries = 6;
    std::array<size_t, 3> sample = DrawAnySample(rng);
    for (int attempt = 1; attempt < kTries && !PlaneThrough(sample); ++attempt) {
      sample = DrawAnySample(rng);
    }
    return sample;
  }

  void Estimate(const std::array<size_t, 3>& sample, std::vector<Plane>& planes) const {
    if (const auto plane = PlaneThrough(sample)) planes.push_back(*plane);
  }

  /// Of outliers a lower bound, which takes less time.
  [[nodiscard]] double SquaredError(const Plane& plane, size_t i) const {
    const double squared_distance = std::pow(plane.SignedDistance(points_[i].xyz), 2);
    if (squared_distance > inlier_bounds_[i]) return squared_distance / variance_bounds_[i];
    return squared_distance / VarianceOf(points_[i], plane);
  }

  [[nodiscard]] std::optional<Plane> Refine(const Plane& plane,
                                            std::span<const size_t> inliers) const {
    constexpr int kRounds = 2;
    std::vector<double> weights(inliers.size());
    PlaneFit fit;
    fit.plane = plane;
    for (int round = 0; round < kRounds; ++round) {
      for (size_t k = 0; k < inliers.size(); ++k) {
        const UncertainPoint& point = points_[inliers[k]];
        const double variance = VarianceOf(point, fit.plane);
        const double squared = std::pow(fit.plane.SignedDistance(point.xyz), 2) / variance;
        weights[k] = LossWeight(kLoss, squared, squared_threshold_) / variance;
      }
      if (!PlaneFromMoments(ComputeMoments(points_, inliers, weights), fit) ||
          !band_.Contains(fit.plane.normal)) {
        return std::nullopt;
      }
    }
    return fit.plane;
  }

 private:
  [[nodiscard]] double VarianceOf(const UncertainPoint& point, const Plane& plane) const {
    return std::max(DistanceVariance(point, plane.normal), min_sigma_ * min_sigma_);
  }

  /// Every other sample is local: in a cluster of several planes, neighbours share one more often.
  [[nodiscard]] std::array<size_t, 3> DrawAnySample(Rng& rng) const {
    constexpr int kTries = 30;
    std::array<size_t, 3> sample = DrawUniformSample<3>(size(), rng);
    if (rng.Below(2) == 0) return sample;
    for (size_t k = 1; k < 3; ++k) {
      for (int attempt = 0; attempt < kTries; ++attempt) {
        const size_t i = rng.Below(size());
        if (std::find(sample.begin(), sample.end(), i) != sample.end()) continue;
        if ((points_[i].xyz - points_[sample[0]].xyz).squaredNorm() > squared_radius_) continue;
        sample[k] = i;
        break;
      }
    }
    return sample;
  }

  /// Empty if the sample is nearly on a line, or its normal outside of the band.
  [[nodiscard]] std::optional<Plane> PlaneThrough(const std::array<size_t, 3>& sample) const {
    constexpr double kMinSine = 0.02;  // Of the angle between two sides of the triangle.
    const Eigen::Vector3d& origin = points_[sample[0]].xyz;
    const Eigen::Vector3d a = points_[sample[1]].xyz - origin;
    const Eigen::Vector3d b = points_[sample[2]].xyz - origin;
    const Eigen::Vector3d normal = a.cross(b);
    if (!(normal.norm() > kMinSine * a.norm() * b.norm())) return std::nullopt;
    const Eigen::Vector3d unit = normal.normalized();
    if (!band_.Contains(unit)) return std::nullopt;
    return Plane{unit, -unit.dot(origin)};
  }

  std::span<const UncertainPoint> points_;
  NormalBand band_;
  double squared_threshold_;
  double squared_radius_ = 0.0;
  double min_sigma_ = 0.0;
  std::vector<double> variance_bounds_;  // Of the points' distances to any plane.
  std::vector<double> inlier_bounds_;    // Squared distances of inliers of any plane.
};

}  // namespace

std::optional<PlaneFit> FitPlane(std::span<const UncertainPoint> points,
                                 std::span<const size_t> indices) {
  if (indices.size() < 3) return std::nullopt;
  std::vector<double> weights(indices.size(), 1.0);
  PlaneFit fit;
  double min_sigma = 0.0;
  for (int round = 0; round <= kReweightings; ++round) {
    if (!PlaneFromMoments(ComputeMoments(points, indices, weights), fit)) return std::nullopt;
    if (round == 0) min_sigma = kMinRelativeSigma * fit.spread_u;
    for (size_t k = 0; k < indices.size(); ++k) {
      const double sigma = std::max(min_sigma, DistanceSigma(points[indices[k]], fit.plane.normal));
      weights[k] = 1.0 / (sigma * sigma);
    }
  }
  fit.inliers.assign(indices.begin(), indices.end());
  ComputeSpreadAndCovariance(points, min_sigma, fit);
  return fit;
}

PlaneFit RefitRobustly(std::span<const UncertainPoint> points, const PlaneFit& fit) {
  constexpr int kRounds = 10;
  constexpr double kMinTurn = 1e-5;  // [rad]
  const double min_sigma = kMinRelativeSigma * fit.spread_u;
  PlaneFit refit = fit;
  for (int round = 0; round < kRounds; ++round) {
    const Plane before = refit.plane;
    const std::vector<double> weights = BiweightsOf(FindDepartures(points, refit, min_sigma));
    if (!PlaneFromMoments(ComputeMoments(points, fit.inliers, weights), refit)) return fit;
    if (PlaneAngle(before, refit.plane) < kMinTurn) break;
  }
  ComputeSpreadAndCovariance(points, min_sigma, refit);
  return refit;
}

std::optional<PlaneFit> FindPlane(std::span<const UncertainPoint> points,
                                  const PlaneFitOptions& options, const NormalBand& band,
                                  Rng& rng) {
  if (points.size() < PlaneEstimator::kSampleSize) return std::nullopt;
  const PlaneEstimator estimator(points, options, band);
  const auto found = Ransac(estimator, options.inlier_sigmas, options.ransac, rng);
  if (!found) return std::nullopt;
  std::optional<PlaneFit> fit = FitPlane(points, found->inliers);
  if (!fit || !band.Contains(fit->plane.normal)) return std::nullopt;
  return fit;
}

bool IsDetermined(std::span<const UncertainPoint> points, const PlaneFit& fit,
                  const PlaneFitOptions& options) {
  if (fit.spread_v < options.min_width_ratio * fit.spread_u) return false;
  if (IsWidthNoise(points, fit)) return false;
  const Eigen::Matrix2d tilt = fit.covariance.topLeftCorner<2, 2>();
  const double tilt_variance =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(tilt, Eigen::EigenvaluesOnly).eigenvalues()[1];
  const double max_tilt = options.max_tilt_sigma_deg * std::numbers::pi / 180.0;
  return tilt_variance < max_tilt * max_tilt;
}

std::optional<PlaneFit> FitPlaneRobustly(std::span<const UncertainPoint> points,
                                         const PlaneFitOptions& options, const NormalBand& band,
                                         Rng& rng) {
  auto fit = FindPlane(points, options, band, rng);
  if (!fit || !IsDetermined(points, *fit, options)) return std::nullopt;
  return fit;
}

}  // namespace s3lam
