#include "s3lam/optim/pose_refinement.h"

#include <gtest/gtest.h>

#include "s3lam/base/rng.h"

namespace s3lam {
namespace {

const PinholeIntrinsics kCamera{500.0, 510.0, 320.0, 240.0};

std::vector<PoseObservation> Observe(const Rigid3& pose, int count, double noise_px, Rng& rng) {
  std::vector<PoseObservation> observations;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d in_camera(rng.Uniform(-2, 2), rng.Uniform(-1.5, 1.5), rng.Uniform(3, 8));
    const Eigen::Vector2d noise(rng.Gaussian(0.0, noise_px), rng.Gaussian(0.0, noise_px));
    observations.push_back({pose.Inverse() * in_camera, kCamera.Project(in_camera) + noise, 1.0});
  }
  return observations;
}

Rigid3 Moved(const Rigid3& pose) {
  Rigid3 moved = pose;
  moved.rotation = QuaternionFromRotationVector({0.02, -0.01, 0.015}) * pose.rotation;
  moved.translation += Eigen::Vector3d(0.05, -0.03, 0.1);
  return moved;
}

const Rigid3 kTruth{QuaternionFromRotationVector({0.3, -0.8, 0.2}), {0.5, -0.2, 1.0}};

TEST(PoseRefinement, RecoversAPoseWithAQuarterOfWrongMatches) {
  Rng rng(3);
  auto observations = Observe(kTruth, 100, 0.5, rng);
  for (size_t i = 0; i < 25; ++i) {
    observations[i].xy = {rng.Uniform(0, 640), rng.Uniform(0, 480)};
  }
  Rigid3 pose = Moved(kTruth);
  const PoseRefinementResult result = RefinePose(kCamera, observations, pose);
  EXPECT_LT(RotationAngle(pose.rotation, kTruth.rotation), 2e-3);
  EXPECT_LT((pose.CenterInB() - kTruth.CenterInB()).norm(), 0.01);
  EXPECT_GE(result.num_inliers, 70);
  EXPECT_LE(result.num_inliers, 77);
}

TEST(PoseRefinement, InformationPredictsTheSpread) {
  Rng rng(5);
  constexpr int kTrials = 200;
  double sum = 0.0;  // Of Mahalanobis distances: 6 each if the information is honest.
  for (int trial = 0; trial < kTrials; ++trial) {
    const auto observations = Observe(kTruth, 60, 1.0, rng);
    Rigid3 pose = kTruth;
    const PoseRefinementResult result = RefinePose(kCamera, observations, pose);
    Eigen::Matrix<double, 6, 1> error;
    error.head<3>() = RotationVectorFromQuaternion(pose.rotation * kTruth.rotation.conjugate());
    error.tail<3>() = pose.translation - kTruth.translation;
    sum += error.dot(result.information * error);
  }
  EXPECT_NEAR(sum / kTrials, 6.0, 1.5);
}

TEST(PoseRefinement, LeavesThePoseAloneWithoutInliers) {
  Rng rng(9);
  auto observations = Observe(kTruth, 20, 0.0, rng);
  for (auto& o : observations) o.xy = {rng.Uniform(0, 640), rng.Uniform(0, 480)};
  const Rigid3 start = Moved(kTruth);
  Rigid3 pose = start;
  const PoseRefinementResult result = RefinePose(kCamera, observations, pose);
  EXPECT_LT(result.num_inliers, 6);
  EXPECT_EQ(pose.translation, start.translation);
}

}  // namespace
}  // namespace s3lam
