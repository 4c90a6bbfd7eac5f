#include "s3lam/refine/flattening.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "refine/refine_fixture.h"
#include "s3lam/refine/problem_builder.h"

namespace s3lam::refine {
namespace {

/// The desk's map with every plane's inliers as members, weighed as while poses are refined.
class FlattenPointsTest : public ::testing::Test {
 protected:
  FlattenPointsTest() : map_(MakeDeskMap()), bundle_(BuildBundleMap(map_.estimate, {})) {
    SelectObservations({}, kSigma, true, bundle_);
    bundle_.problem.gauge = ChooseGauge(bundle_.problem);
    planes_ = BuildPlaneModel({}, map_.semantics, bundle_);
    FreezeUncertainty(bundle_.problem, kSigma, planes_);
    solver_.sigma_px = kSigma;
  }

  void Flatten(double kappa) {
    bundle_.problem.points_on_planes.clear();
    for (size_t k = 0; k < planes_.planes.size(); ++k) {
      planes_.planes[k].kappa = kappa;
      for (const int i : planes_.planes[k].candidates) {
        bundle_.problem.points_on_planes.push_back({i, static_cast<int>(k), 1.0});
      }
    }
    std::sort(bundle_.problem.points_on_planes.begin(), bundle_.problem.points_on_planes.end(),
              [](const auto& a, const auto& b) {
                return std::pair(a.point, a.plane) < std::pair(b.point, b.plane);
              });
    FlattenPoints(solver_, sigma_, planes_, nullptr, bundle_.problem);
  }

  [[nodiscard]] double PlaneRms() const {
    double sum = 0.0;
    for (const PointOnPlane& term : bundle_.problem.points_on_planes) {
      const Plane plane = bundle_.problem.planes[term.plane].PlaneInWorld();
      sum += std::pow(plane.SignedDistance(bundle_.problem.points[term.point]), 2);
    }
    return std::sqrt(sum / static_cast<double>(bundle_.problem.points_on_planes.size()));
  }

  static constexpr double kSigma = 0.7;  // px

  SyntheticMap map_;
  BundleMap bundle_;
  PlaneModel planes_;
  BundleSolverOptions solver_;
  PlaneSigmaOptions sigma_;
};

TEST_F(FlattenPointsTest, PointsMoveToTheirPlanesAndNothingElseMoves) {
  bundle_.problem.pose_is_constant[1] = 1;
  const BundleProblem before = bundle_.problem;
  Flatten(1.0);
  ASSERT_GT(bundle_.problem.points_on_planes.size(), 100U);
  const double once = PlaneRms();
  EXPECT_EQ(bundle_.problem.poses, before.poses);
  EXPECT_EQ(bundle_.problem.pose_is_constant, before.pose_is_constant);
  for (size_t k = 0; k < before.planes.size(); ++k) {
    EXPECT_EQ(bundle_.problem.planes[k].parameters, before.planes[k].parameters);
    EXPECT_FALSE(bundle_.problem.planes[k].is_constant);
  }
  // The more of their scatter is laid to keypoints, the flatter.
  bundle_.problem.points = before.points;
  Flatten(4.0);
  EXPECT_LT(PlaneRms(), 0.3 * once);
}

TEST_F(FlattenPointsTest, SigmasInMetresAreLeftAlone) {
  sigma_.kind = PlaneSigmaKind::kMetric;
  const std::vector<Eigen::Vector3d> before = bundle_.problem.points;
  Flatten(1.0);
  EXPECT_EQ(bundle_.problem.points, before);
}

}  // namespace
}  // namespace s3lam::refine
