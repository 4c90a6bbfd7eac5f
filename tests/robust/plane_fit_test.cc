#include "s3lam/robust/plane_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

namespace s3lam {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

Plane MakePlane(const Eigen::Vector3d& normal, double offset) {
  return {normal.normalized(), offset};
}

/// Points on a plane within a disc-like patch about its foot point, off by `sigma` along the
/// normal.
std::vector<UncertainPoint> SamplePlane(const Plane& plane, size_t count, double extent,
                                        double sigma, Rng& rng) {
  const auto [u, v] = PlaneAxes(plane.normal);
  std::vector<UncertainPoint> points;
  for (size_t i = 0; i < count; ++i) {
    const double a = rng.Uniform(-extent, extent);
    const double b = rng.Uniform(-extent, extent);
    const Eigen::Vector3d x =
        (rng.Gaussian(0.0, sigma) - plane.offset) * plane.normal + a * u + b * v;
    points.push_back({x, sigma * sigma * Eigen::Matrix3d::Identity()});
  }
  return points;
}

void AddClutter(size_t count, double extent, double sigma, Rng& rng,
                std::vector<UncertainPoint>& points) {
  for (size_t i = 0; i < count; ++i) {
    Eigen::Vector3d x;
    for (double& c : x) c = rng.Uniform(-extent, extent);
    points.push_back({x, sigma * sigma * Eigen::Matrix3d::Identity()});
  }
}

std::vector<size_t> AllOf(const std::vector<UncertainPoint>& points) {
  std::vector<size_t> indices(points.size());
  std::iota(indices.begin(), indices.end(), size_t{0});
  return indices;
}

TEST(FitPlane, RecoversAPlaneWithoutNoise) {
  Rng rng(1);
  const Plane truth = MakePlane({1, -2, 0.5}, 3.0);
  const auto points = SamplePlane(truth, 20, 2.0, 0.0, rng);
  const auto fit = FitPlane(points, AllOf(points));
  ASSERT_TRUE(fit);
  EXPECT_LT(PlaneAngle(fit->plane, truth), 1e-7);
  EXPECT_NEAR(std::abs(fit->plane.offset), 3.0, 1e-9);
  EXPECT_LT(fit->rms, 1e-9);
  EXPECT_NEAR(fit->plane.SignedDistance(fit->centroid), 0.0, 1e-9);
  EXPECT_NEAR(fit->axis_u.cross(fit->axis_v).dot(-fit->plane.normal), -1.0, 1e-9);
}

TEST(FitPlane, TrustsCertainPointsMore) {
  Rng rng(2);
  const Plane truth = MakePlane({0, 0, 1}, 0.0);
  auto points = SamplePlane(truth, 100, 1.0, 0.001, rng);
  auto poor = SamplePlane(MakePlane({0, 0.1, 1}, 0.1), 100, 1.0, 0.1, rng);
  points.insert(points.end(), poor.begin(), poor.end());
  const auto fit = FitPlane(points, AllOf(points));
  ASSERT_TRUE(fit);
  EXPECT_LT(PlaneAngle(fit->plane, truth), 0.1 * kDegree);
}

TEST(FitPlane, RefusesLinesSpotsAndPairs) {
  std::vector<UncertainPoint> line;
  for (int i = 0; i < 10; ++i) line.push_back({{1.0 * i, 2.0 * i, 3.0 * i}, {}});
  for (auto& p : line) p.covariance.setIdentity();
  EXPECT_FALSE(FitPlane(line, AllOf(line)));
  const std::vector<UncertainPoint> spot(5, UncertainPoint{});
  EXPECT_FALSE(FitPlane(spot, AllOf(spot)));
  EXPECT_FALSE(FitPlane(line, std::vector<size_t>{0, 1}));
}

TEST(FitPlane, CovarianceMatchesTheScatterOfRepeatedFits) {
  const Plane truth = MakePlane({0.2, 0.1, 1}, -2.0);
  constexpr int kRuns = 300;
  double squared_angles = 0.0;
  double predicted = 0.0;
  double squared_shifts = 0.0;
  double predicted_shift = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    Rng rng(100 + static_cast<uint64_t>(run));
    const auto points = SamplePlane(truth, 60, 1.0, 0.01, rng);
    const auto fit = FitPlane(points, AllOf(points));
    ASSERT_TRUE(fit);
    squared_angles += std::pow(PlaneAngle(fit->plane, truth), 2);
    predicted += fit->covariance(0, 0) + fit->covariance(1, 1);
    squared_shifts += std::pow(truth.SignedDistance(fit->centroid), 2);
    predicted_shift += fit->covariance(2, 2);
  }
  EXPECT_NEAR(predicted / squared_angles, 1.0, 0.2);
  EXPECT_NEAR(predicted_shift / squared_shifts, 1.0, 0.25);
}

/// A smooth surface said to be rough; of the points near one of its sides, half are of a ledge that
/// stands out by no more than that.
std::vector<UncertainPoint> SurfaceWithALedge(const Plane& surface, double roughness, Rng& rng) {
  auto points = SamplePlane(surface, 300, 1.0, 0.001, rng);
  const auto [u, v] = PlaneAxes(surface.normal);
  for (UncertainPoint& point : points) {
    if (u.dot(point.xyz) > 0.5 && rng.Below(2) == 0) point.xyz += 1.5 * roughness * surface.normal;
    point.roughness = roughness;
  }
  return points;
}

TEST(RefitRobustly, IsNotPulledByWhatRoughnessWouldExplain) {
  Rng rng(5);
  const Plane truth = MakePlane({1, 2, 3}, 1.0);
  const auto points = SurfaceWithALedge(truth, 0.02, rng);
  const auto fit = FitPlane(points, AllOf(points));
  ASSERT_TRUE(fit);
  EXPECT_GT(PlaneAngle(fit->plane, truth), 0.3 * kDegree);
  const PlaneFit refit = RefitRobustly(points, *fit);
  EXPECT_LT(PlaneAngle(refit.plane, truth), 0.03 * kDegree);
  EXPECT_EQ(refit.inliers, fit->inliers);
  EXPECT_GT(refit.rms, fit->rms);  // Least squares has the smallest.
}

TEST(RefitRobustly, IsNearlyAsGoodAsLeastSquaresWithoutOutliers) {
  const Plane truth = MakePlane({0.2, 0.1, 1}, -2.0);
  double squared = 0.0;
  double refit_squared = 0.0;
  for (uint64_t seed = 0; seed < 200; ++seed) {
    Rng rng(seed);
    auto points = SamplePlane(truth, 60, 1.0, 0.01, rng);
    for (UncertainPoint& point : points) point.roughness = 0.02;
    const auto fit = FitPlane(points, AllOf(points));
    ASSERT_TRUE(fit);
    squared += std::pow(PlaneAngle(fit->plane, truth), 2);
    refit_squared += std::pow(PlaneAngle(RefitRobustly(points, *fit).plane, truth), 2);
  }
  EXPECT_LT(refit_squared, 1.25 * squared);
}

TEST(RefitRobustly, LeavesAPlaneThroughExactPointsAlone) {
  Rng rng(6);
  const Plane truth = MakePlane({1, -2, 0.5}, 3.0);
  const auto points = SamplePlane(truth, 20, 2.0, 0.0, rng);
  const auto fit = FitPlane(points, AllOf(points));
  ASSERT_TRUE(fit);
  EXPECT_LT(PlaneAngle(RefitRobustly(points, *fit).plane, truth), 1e-7);
}

class RobustPlane : public ::testing::TestWithParam<double> {};

TEST_P(RobustPlane, RecoversUnderOutliers) {
  const double outlier_share = GetParam();
  const Plane truth = MakePlane({1, 1, 4}, -1.0);
  for (uint64_t seed = 0; seed < 10; ++seed) {
    Rng rng(seed);
    auto points = SamplePlane(truth, 200, 1.0, 0.005, rng);
    const auto clutter = static_cast<size_t>(200.0 * outlier_share / (1.0 - outlier_share));
    AddClutter(clutter, 1.5, 0.005, rng, points);
    const auto fit = FitPlaneRobustly(points, PlaneFitOptions{}, NormalBand{}, rng);
    ASSERT_TRUE(fit) << "seed " << seed;
    EXPECT_LT(PlaneAngle(fit->plane, truth), 0.3 * kDegree) << "seed " << seed;
    EXPECT_GT(fit->inliers.size(), 170U) << "seed " << seed;
    EXPECT_LT(fit->inliers.size(), 200U + clutter / 10) << "seed " << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(OutlierShares, RobustPlane, ::testing::Values(0.0, 0.3, 0.6, 0.75));

/// A line with noise of these standard deviations along the axes, as the points say.
std::vector<UncertainPoint> SampleLine(size_t count, const Eigen::Vector3d& sigma, Rng& rng) {
  std::vector<UncertainPoint> points;
  for (size_t i = 0; i < count; ++i) {
    Eigen::Vector3d noise;
    for (int c = 0; c < 3; ++c) noise[c] = rng.Gaussian(0.0, sigma[c]);
    points.push_back(
        {Eigen::Vector3d(rng.Uniform(-1, 1), 0, 0) + noise, sigma.cwiseAbs2().asDiagonal()});
  }
  return points;
}

TEST(FitPlaneRobustly, RefusesCollinearPoints) {
  for (const size_t count : {100U, 1000U, 5000U}) {
    Rng rng(3);
    auto points = SampleLine(count, {0.001, 0.001, 0.001}, rng);
    EXPECT_FALSE(FitPlaneRobustly(points, PlaneFitOptions{}, NormalBand{}, rng)) << count;
    for (UncertainPoint& point : points) point.covariance *= 0.25;  // Half as certain as they say.
    EXPECT_FALSE(FitPlaneRobustly(points, PlaneFitOptions{}, NormalBand{}, rng)) << count;
  }
}

TEST(FitPlaneRobustly, RefusesALineThatIsWideWherePointsAreUncertain) {
  Rng rng(3);
  const auto points = SampleLine(1000, {0.001, 0.05, 0.001}, rng);
  EXPECT_FALSE(FitPlaneRobustly(points, PlaneFitOptions{}, NormalBand{}, rng));
}

TEST(FitPlaneRobustly, AcceptsALongStreet) {
  for (const double length : {700.0, 2500.0, 10000.0}) {
    Rng rng(7);
    std::vector<UncertainPoint> points;
    for (int i = 0; i < 500; ++i) {
      const double x = rng.Uniform(0.0, length);
      points.push_back({{x, rng.Uniform(0.0, 8.0), rng.Gaussian(0.0, 0.05)},
                        0.05 * 0.05 * Eigen::Matrix3d::Identity()});
    }
    const auto fit = FitPlaneRobustly(points, PlaneFitOptions{}, NormalBand{}, rng);
    ASSERT_TRUE(fit) << length;
    EXPECT_LT(PlaneAngle(fit->plane, MakePlane({0, 0, 1}, 0.0)), 0.3 * kDegree);
    EXPECT_GT(fit->inliers.size(), 450U);
  }
}

TEST(FitPlaneRobustly, RefusesAnUncertainTilt) {
  Rng rng(4);
  const Plane plane = MakePlane({0, 0, 1}, 0.0);
  PlaneFitOptions options;
  options.max_tilt_sigma_deg = 1.0;
  const auto small = SamplePlane(plane, 30, 0.02, 0.01, rng);
  EXPECT_FALSE(FitPlaneRobustly(small, options, NormalBand{}, rng));
  const auto large = SamplePlane(plane, 30, 1.0, 0.01, rng);
  EXPECT_TRUE(FitPlaneRobustly(large, options, NormalBand{}, rng));
}

TEST(FitPlaneRobustly, KeepsTheNormalInTheBand) {
  Rng rng(8);
  auto points = SamplePlane(MakePlane({0, 0, 1}, 0.0), 200, 1.0, 0.01, rng);
  const auto wall = SamplePlane(MakePlane({1, 0, 0}, 0.5), 100, 1.0, 0.01, rng);
  points.insert(points.end(), wall.begin(), wall.end());
  const NormalBand vertical{Eigen::Vector3d::UnitZ(), 0.0, 0.2};
  const auto fit = FitPlaneRobustly(points, PlaneFitOptions{}, vertical, rng);
  ASSERT_TRUE(fit);
  EXPECT_GT(std::abs(fit->plane.normal.x()), std::cos(0.5 * kDegree));
  const NormalBand slanted{Eigen::Vector3d::UnitZ(), 0.6, 0.8};
  const auto none = FitPlaneRobustly(points, PlaneFitOptions{}, slanted, rng);
  EXPECT_TRUE(!none || slanted.Contains(none->plane.normal));
}

TEST(FitPlaneRobustly, RefusesTooFewPoints) {
  Rng rng(5);
  const auto points = SamplePlane(MakePlane({0, 0, 1}, 0.0), 2, 1.0, 0.01, rng);
  EXPECT_FALSE(FitPlaneRobustly(points, PlaneFitOptions{}, NormalBand{}, rng));
  EXPECT_FALSE(FitPlaneRobustly({}, PlaneFitOptions{}, NormalBand{}, rng));
}

TEST(FitPlaneRobustly, IsDeterministicInTheSeed) {
  Rng noise(6);
  auto points = SamplePlane(MakePlane({0, 1, 1}, 1.0), 100, 1.0, 0.01, noise);
  AddClutter(100, 1.0, 0.01, noise, points);
  Rng a(9);
  Rng b(9);
  const auto first = FitPlaneRobustly(points, PlaneFitOptions{}, NormalBand{}, a);
  const auto second = FitPlaneRobustly(points, PlaneFitOptions{}, NormalBand{}, b);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->inliers, second->inliers);
  EXPECT_EQ(first->plane.offset, second->plane.offset);
}

TEST(FitPlaneRobustly, TakesOneOfTwoLayersAndNotTheMiddle) {
  // Points scatter by a tenth of what they claim; the layers are 2.5 of the claimed sigma apart.
  constexpr double kClaimed = 0.02;
  Rng rng(4);
  std::vector<UncertainPoint> points;
  for (const double offset : {0.0, 2.5 * kClaimed}) {
    for (UncertainPoint& point :
         SamplePlane(MakePlane({0, 0, 1}, offset), 100, 1.0, 0.1 * kClaimed, rng)) {
      point.covariance = kClaimed * kClaimed * Eigen::Matrix3d::Identity();
      points.push_back(point);
    }
  }
  const auto fit = FitPlaneRobustly(points, PlaneFitOptions{}, NormalBand{}, rng);
  ASSERT_TRUE(fit);
  EXPECT_EQ(fit->inliers.size(), 100U);
  EXPECT_LT(fit->rms, 0.2 * kClaimed);
}

}  // namespace
}  // namespace s3lam
