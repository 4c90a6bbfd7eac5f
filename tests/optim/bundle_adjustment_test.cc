#include "s3lam/optim/bundle_adjustment.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "s3lam/base/rng.h"
#include "s3lam/geometry/alignment.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

struct Truth {
  std::vector<Rigid3> poses;
  std::vector<Eigen::Vector3d> points;
};

/// `num_poses` cameras on an arc around `num_points` points; each point is seen by a run of
/// `seen_by` neighbouring cameras, so that the reduced system is banded for long arcs.
BaProblem MakeProblem(int num_poses, int num_points, int seen_by, double noise_px, Truth& truth) {
  Rng rng(7);
  BaProblem problem;
  problem.camera = {500.0, 500.0, 320.0, 240.0};
  for (int i = 0; i < num_poses; ++i) {
    const double angle = 0.05 * i;
    const Eigen::Vector3d center(4.0 * std::sin(angle), -4.0 * std::cos(angle),
                                 0.3 * std::cos(2.0 * angle));
    truth.poses.push_back(testing::LookAt(center, Eigen::Vector3d::Zero()));
  }
  problem.poses = truth.poses;
  problem.pose_is_fixed.assign(static_cast<size_t>(num_poses), 0);
  for (int p = 0; p < num_points; ++p) {
    const Eigen::Vector3d point(rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1));
    const int first =
        static_cast<int>(rng.Below(static_cast<uint64_t>(std::max(1, num_poses - seen_by + 1))));
    for (int i = first; i < std::min(num_poses, first + seen_by); ++i) {
      const Eigen::Vector2d xy = problem.camera.Project(truth.poses[i] * point) +
                                 noise_px * Eigen::Vector2d(rng.Gaussian(), rng.Gaussian());
      problem.observations.push_back({i, p, xy, 1.0});
    }
    truth.points.push_back(point);
  }
  problem.points = truth.points;
  return problem;
}

void Perturb(double amount, BaProblem& problem) {
  Rng rng(11);
  const auto random = [&] {
    return Eigen::Vector3d(rng.Gaussian(), rng.Gaussian(), rng.Gaussian());
  };
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    if (problem.pose_is_fixed[i] != 0) continue;
    problem.poses[i].rotation =
        QuaternionFromRotationVector(amount * random()) * problem.poses[i].rotation;
    problem.poses[i].translation += amount * random();
  }
  for (Eigen::Vector3d& point : problem.points) point += amount * random();
}

/// RMS distance of points after the similarity that the gauge leaves free.
double PointError(const BaProblem& problem, const Truth& truth) {
  const auto truth_from_problem = AlignPoints(truth.points, problem.points);
  if (!truth_from_problem) return std::numeric_limits<double>::infinity();
  double sum = 0.0;
  for (size_t i = 0; i < truth.points.size(); ++i) {
    sum += (*truth_from_problem * problem.points[i] - truth.points[i]).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(truth.points.size()));
}

TEST(BundleAdjustment, RecoversExactSceneFromNoise) {
  Truth truth;
  BaProblem problem = MakeProblem(6, 80, 6, 0.0, truth);
  problem.pose_is_fixed[0] = 1;
  Perturb(0.02, problem);
  BundleAdjustmentOptions options;
  options.max_iterations = 50;
  options.min_relative_decrease = 1e-12;
  const BundleAdjustmentReport report = AdjustBundle(options, problem);
  EXPECT_TRUE(report.usable);
  EXPECT_GT(report.initial_cost, 100.0);
  EXPECT_LT(report.final_cost, 1e-8);
  EXPECT_LT(PointError(problem, truth), 1e-6);
}

TEST(BundleAdjustment, SparseSystemsAreSolvedAsWell) {
  Truth truth;
  // 6 * 170 unknowns of which each is coupled with few: beyond the size that is factored densely.
  BaProblem problem = MakeProblem(170, 1500, 6, 0.0, truth);
  problem.pose_is_fixed[0] = 1;
  problem.pose_is_fixed[1] = 1;
  Perturb(0.002, problem);
  BundleAdjustmentOptions options;
  options.max_iterations = 60;
  options.min_relative_decrease = 1e-12;
  EXPECT_LT(AdjustBundle(options, problem).final_cost, 1e-6);
  EXPECT_LT(PointError(problem, truth), 1e-4);
}

TEST(BundleAdjustment, FixedPosesStay) {
  Truth truth;
  BaProblem problem = MakeProblem(5, 60, 5, 0.5, truth);
  problem.pose_is_fixed = {1, 0, 1, 0, 0};
  Perturb(0.01, problem);
  AdjustBundle({}, problem);
  for (const size_t i : {0UL, 2UL}) {
    EXPECT_EQ(problem.poses[i].translation, truth.poses[i].translation);
    EXPECT_EQ(problem.poses[i].rotation.coeffs(), truth.poses[i].rotation.coeffs());
  }
  EXPECT_NE(problem.poses[1].translation, truth.poses[1].translation);
}

TEST(BundleAdjustment, OneWrongObservationDoesLittle) {
  Truth truth;
  BaProblem problem = MakeProblem(6, 80, 6, 0.0, truth);
  problem.pose_is_fixed[0] = 1;
  problem.observations[3].xy += Eigen::Vector2d(80.0, -60.0);
  BundleAdjustmentOptions options;
  options.max_iterations = 50;
  AdjustBundle(options, problem);
  EXPECT_LT(PointError(problem, truth), 0.02);
}

TEST(BundleAdjustment, SameBytesForAnyNumberOfThreads) {
  Truth truth;
  BaProblem reference = MakeProblem(20, 1500, 8, 0.7, truth);
  reference.pose_is_fixed[0] = 1;
  Perturb(0.01, reference);
  BaProblem one = reference;
  BundleAdjustmentOptions options;
  AdjustBundle(options, one);
  for (const int threads : {2, 8}) {
    BaProblem many = reference;
    options.num_threads = threads;
    AdjustBundle(options, many);
    for (size_t i = 0; i < one.points.size(); ++i) ASSERT_EQ(one.points[i], many.points[i]);
    for (size_t i = 0; i < one.poses.size(); ++i) {
      ASSERT_EQ(one.poses[i].translation, many.poses[i].translation);
    }
  }
}

TEST(BundleAdjustment, NeverRaisesTheCostWithPointsBehind) {
  Truth truth;
  BaProblem problem = MakeProblem(4, 40, 4, 0.5, truth);
  problem.pose_is_fixed[0] = 1;
  for (size_t i = 0; i < 10; ++i) problem.points[i] *= 100.0;  // Some are behind now.
  const BundleAdjustmentReport report = AdjustBundle({}, problem);
  EXPECT_TRUE(report.usable);
  EXPECT_LE(report.final_cost, report.initial_cost);
}

TEST(BundleAdjustment, RejectsObservationsOutOfOrder) {
  Truth truth;
  BaProblem problem = MakeProblem(3, 10, 3, 0.0, truth);
  std::swap(problem.observations.front(), problem.observations.back());
  EXPECT_THROW(AdjustBundle({}, problem), std::logic_error);
}

TEST(SquaredErrorOfProjection, IsInfiniteFromBehind) {
  const PinholeIntrinsics camera{500.0, 500.0, 320.0, 240.0};
  EXPECT_EQ(SquaredError(camera, {}, {0.0, 0.0, -1.0}, {320.0, 240.0}, 1.0),
            std::numeric_limits<double>::infinity());
  EXPECT_NEAR(SquaredError(camera, {}, {0.0, 0.0, 2.0}, {323.0, 244.0}, 0.5), 6.25, 1e-12);
}

}  // namespace
}  // namespace s3lam
