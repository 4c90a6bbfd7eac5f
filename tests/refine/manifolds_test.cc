#include "s3lam/refine/manifolds.h"

#include <ceres/manifold_test_utils.h>
#include <gtest/gtest.h>

#include "s3lam/base/rng.h"

namespace s3lam {
namespace {

using namespace ceres;  // The invariants' macro expects its matchers in scope.

constexpr double kTolerance = 1e-9;

ceres::Vector RandomVector(Rng& rng, int size, double sigma) {
  ceres::Vector v(size);
  for (double& x : v) x = rng.Gaussian(0.0, sigma);
  return v;
}

ceres::Vector RandomPose(Rng& rng) {
  const Eigen::Vector3d omega = RandomVector(rng, 3, 1.0);
  const Eigen::Vector3d translation = RandomVector(rng, 3, 3.0);
  const PoseBlock block = ToPoseBlock({QuaternionFromRotationVector(omega), translation});
  return Eigen::Map<const ceres::Vector>(block.data(), 7);
}

TEST(PoseManifold, Invariants) {
  Rng rng(1);
  const PoseManifold manifold;
  for (int i = 0; i < 20; ++i) {
    const ceres::Vector x = RandomPose(rng);
    const ceres::Vector delta = RandomVector(rng, 6, 0.5);
    // By Plus, since a quaternion and its opposite are one pose but not the same seven numbers.
    PoseBlock y_block;
    ASSERT_TRUE(manifold.Plus(x.data(), RandomVector(rng, 6, 0.8).eval().data(), y_block.data()));
    const ceres::Vector y = Eigen::Map<const ceres::Vector>(y_block.data(), 7);
    EXPECT_THAT_MANIFOLD_INVARIANTS_HOLD(manifold, x, delta, y, kTolerance);
  }
}

TEST(PoseManifold, DeltaActsOnTheLeft) {
  Rng rng(2);
  const ceres::Vector x = RandomPose(rng);
  const Eigen::Vector3d point(0.3, -0.7, 2.0);
  const std::array<double, 6> delta{0.1, -0.2, 0.05, 1.0, 2.0, -3.0};
  PoseBlock moved;
  ASSERT_TRUE(PoseManifold().Plus(x.data(), delta.data(), moved.data()));
  const Eigen::Vector3d expected =
      QuaternionFromRotationVector({0.1, -0.2, 0.05}) * (FromPoseBlock(x.data()) * point) +
      Eigen::Vector3d(1.0, 2.0, -3.0);
  EXPECT_LT((FromPoseBlock(moved.data()) * point - expected).norm(), 1e-12);
}

TEST(HeldDistancePoseManifold, Invariants) {
  Rng rng(3);
  const Eigen::Vector3d held(0.5, -1.0, 2.0);
  const HeldDistancePoseManifold manifold(held);
  for (int i = 0; i < 20; ++i) {
    const ceres::Vector x = RandomPose(rng);
    const ceres::Vector delta = RandomVector(rng, 5, 0.5);
    // Another pose at the same distance: only such poses are on the manifold.
    PoseBlock y_block;
    ASSERT_TRUE(manifold.Plus(x.data(), RandomVector(rng, 5, 0.8).eval().data(), y_block.data()));
    const ceres::Vector y = Eigen::Map<const ceres::Vector>(y_block.data(), 7);
    EXPECT_THAT_MANIFOLD_INVARIANTS_HOLD(manifold, x, delta, y, kTolerance);
  }
}

TEST(HeldDistancePoseManifold, KeepsTheDistance) {
  Rng rng(4);
  const Eigen::Vector3d held(0.5, -1.0, 2.0);
  const HeldDistancePoseManifold manifold(held);
  ceres::Vector x = RandomPose(rng);
  const double distance = (FromPoseBlock(x.data()).CenterInB() - held).norm();
  for (int i = 0; i < 100; ++i) {
    PoseBlock moved;
    ASSERT_TRUE(manifold.Plus(x.data(), RandomVector(rng, 5, 0.3).eval().data(), moved.data()));
    x = Eigen::Map<const ceres::Vector>(moved.data(), 7);
    EXPECT_NEAR((FromPoseBlock(x.data()).CenterInB() - held).norm(), distance, 1e-12 * distance);
  }
}

TEST(AnchoredPlaneManifold, Invariants) {
  Rng rng(5);
  const AnchoredPlaneManifold manifold;
  for (int i = 0; i < 20; ++i) {
    ceres::Vector x = RandomVector(rng, 4, 1.0);
    ceres::Vector y = RandomVector(rng, 4, 1.0);
    x.head<3>().normalize();
    y.head<3>().normalize();
    const ceres::Vector delta = RandomVector(rng, 3, 0.5);
    EXPECT_THAT_MANIFOLD_INVARIANTS_HOLD(manifold, x, delta, y, kTolerance);
  }
}

}  // namespace
}  // namespace s3lam
