#include "s3lam/eval/trajectory_error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "eval/numpy_reference.h"
#include "s3lam/base/rng.h"
#include "s3lam/io/trajectory.h"
#include "support/run_program.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

Trajectory AtTimes(const std::vector<double>& times) {
  Trajectory trajectory;
  for (const double time_s : times) trajectory.push_back({time_s, {}});
  return trajectory;
}

Eigen::Vector3d RandomVector(Rng& rng, double sigma) {
  const double x = rng.Gaussian(0.0, sigma);
  const double y = rng.Gaussian(0.0, sigma);
  return {x, y, rng.Gaussian(0.0, sigma)};
}

/// A smooth curve with turning cameras.
Trajectory Curve(int size) {
  Trajectory trajectory;
  for (int i = 0; i < size; ++i) {
    const double s = 0.1 * i;
    trajectory.push_back({10.0 + 0.05 * i,
                          {QuaternionFromRotationVector({0.2 * s, 0.1, -0.3 * s}),
                           {2.0 * std::cos(s), std::sin(s), 0.3 * s}}});
  }
  return trajectory;
}

Trajectory Moved(const Trajectory& trajectory, const Similarity3& new_from_old, double noise,
                 uint64_t seed = 1) {
  Rng rng(seed);
  Trajectory moved = trajectory;
  for (TimedPose& pose : moved) {
    Rigid3& world_from_camera = pose.world_from_camera;
    const Eigen::Quaterniond turn = QuaternionFromRotationVector(RandomVector(rng, noise));
    world_from_camera.translation =
        new_from_old * (world_from_camera.translation + RandomVector(rng, noise));
    world_from_camera.rotation =
        (new_from_old.rotation * world_from_camera.rotation * turn).normalized();
  }
  return moved;
}

const Similarity3 kSimilarity{2.5, QuaternionFromRotationVector({0.5, -1.0, 2.0}), {3.0, 1.0, 7.0}};

TEST(AssociateByTime, PairsNearestPosesOnce) {
  EXPECT_THAT(AssociateByTime(AtTimes({0.0, 1.0, 2.0}), AtTimes({0.01, 0.99, 2.1}), 0.02),
              ElementsAre(Pair(0, 0), Pair(1, 1)));
  // Two poses near one: the nearer takes it, whichever side is denser.
  EXPECT_THAT(AssociateByTime(AtTimes({0.0, 0.04, 0.08}), AtTimes({0.05}), 1.0),
              ElementsAre(Pair(1, 0)));
  EXPECT_THAT(AssociateByTime(AtTimes({0.05}), AtTimes({0.0, 0.04, 0.08}), 1.0),
              ElementsAre(Pair(0, 1)));
  EXPECT_TRUE(AssociateByTime(AtTimes({0.0}), AtTimes({}), 1.0).empty());
  EXPECT_TRUE(AssociateByTime(AtTimes({0.0, 5.0}), AtTimes({1.0, 2.0}), 0.5).empty());
  EXPECT_THAT(AssociateByTime(AtTimes({1.0}), AtTimes({1.0}), 0.0), ElementsAre(Pair(0, 0)));
}

TEST(ErrorStatistics, OfKnownNumbers) {
  const ErrorStatistics even = ComputeErrorStatistics({4.0, 1.0, 3.0, 2.0});
  EXPECT_EQ(even.count, 4u);
  EXPECT_DOUBLE_EQ(even.mean, 2.5);
  EXPECT_DOUBLE_EQ(even.median, 2.5);
  EXPECT_DOUBLE_EQ(even.rmse, std::sqrt(7.5));
  EXPECT_DOUBLE_EQ(even.std, std::sqrt(1.25));
  EXPECT_EQ(even.min, 1.0);
  EXPECT_EQ(even.max, 4.0);
  EXPECT_DOUBLE_EQ(ComputeErrorStatistics({5.0, 1.0, 9.0}).median, 5.0);
  EXPECT_EQ(ComputeErrorStatistics({}).count, 0u);
}

TEST(CompareTrajectories, AlignmentRemovesASimilarity) {
  const Trajectory truth = Curve(40);
  const Trajectory estimate = Moved(truth, kSimilarity.Inverse(), 0.0);
  const auto sim3 = CompareTrajectories(estimate, truth);
  ASSERT_TRUE(sim3.has_value());
  EXPECT_EQ(sim3->num_pairs, 40u);
  EXPECT_NEAR(sim3->truth_from_estimate.scale, 2.5, 1e-9);
  EXPECT_LT(sim3->ate_translation.max, 1e-9);
  EXPECT_LT(sim3->ate_rotation_deg.max, 1e-6);
  EXPECT_LT(sim3->rpe_translation.max, 1e-9);
  EXPECT_EQ(sim3->rpe_translation.count, 39u);

  const auto se3 = CompareTrajectories(estimate, truth, {TrajectoryAlignment::kSe3});
  ASSERT_TRUE(se3.has_value());
  EXPECT_EQ(se3->truth_from_estimate.scale, 1.0);
  EXPECT_GT(se3->ate_translation.rmse, 0.5);
  EXPECT_LT(se3->ate_rotation_deg.max, 1e-6);

  const auto none = CompareTrajectories(estimate, truth, {TrajectoryAlignment::kNone});
  ASSERT_TRUE(none.has_value());
  EXPECT_GT(none->ate_translation.rmse, 1.0);
  EXPECT_GT(none->ate_rotation_deg.min, 1.0);
}

TEST(CompareTrajectories, AShiftShowsOnItsAxis) {
  const Trajectory truth = Curve(20);
  const Trajectory estimate =
      Moved(truth, {1.0, Eigen::Quaterniond::Identity(), {0, 0.25, 0}}, 0.0);
  const auto errors = CompareTrajectories(estimate, truth, {TrajectoryAlignment::kNone});
  ASSERT_TRUE(errors.has_value());
  EXPECT_NEAR(errors->ate_translation.rmse, 0.25, 1e-12);
  EXPECT_NEAR(errors->ate_rmse_per_axis.y(), 0.25, 1e-12);
  EXPECT_NEAR(errors->ate_rmse_per_axis.x(), 0.0, 1e-12);
  EXPECT_NEAR(errors->rpe_translation.max, 0.0, 1e-12);
  EXPECT_EQ(errors->poses.size(), 20u);
  EXPECT_EQ(errors->poses[3].time_s, truth[3].time_s);
}

TEST(CompareTrajectories, WhatCannotBeComparedIsEmpty) {
  const Trajectory truth = Curve(20);
  EXPECT_FALSE(CompareTrajectories(AtTimes({10.0, 10.05}), truth).has_value());
  EXPECT_FALSE(CompareTrajectories(AtTimes({0.0, 1.0, 2.0, 3.0}), truth).has_value());
  // All on one spot.
  EXPECT_FALSE(CompareTrajectories(AtTimes({10.0, 10.05, 10.1, 10.15}), truth).has_value());
}

TEST(CompareTrajectories, AgreesWithNumpy) {
  const auto python = testing::PythonWithNumpy();
  if (!python) GTEST_SKIP() << "python3 with numpy is not installed";
  const Trajectory truth = Curve(60);
  Trajectory estimate = Moved(truth, kSimilarity.Inverse(), 0.05);
  for (size_t i = 0; i < estimate.size(); ++i) estimate[i].time_s += i % 3 == 0 ? 0.004 : -0.003;
  estimate.erase(estimate.begin() + 10, estimate.begin() + 17);
  const testing::TempDir dir;
  WriteTumTrajectory(truth, dir / "truth.txt");
  WriteTumTrajectory(estimate, dir / "estimate.txt");
  TrajectoryErrorOptions options;
  options.segment_lengths_m = {1.0, 2.5, 5.0, 1000.0};
  options.segment_step_frames = 3;
  options.rpe_delta_m = 0.7;
  for (const auto align :
       {TrajectoryAlignment::kSim3, TrajectoryAlignment::kSe3, TrajectoryAlignment::kNone}) {
    for (const int delta : {1, 5}) {
      options.align = align;
      options.rpe_delta_frames = delta;
      const auto errors = CompareTrajectories(estimate, truth, options);
      ASSERT_TRUE(errors.has_value());
      EXPECT_EQ(errors->segments.by_length.size(), 3u);  // None is 1000 long.
      testing::ExpectAgreesWithNumpy(*python, dir / "estimate.txt", dir / "truth.txt", *errors);
    }
  }
}

TEST(TrajectoryErrors, JsonAndTableHaveTheNumbers) {
  const Trajectory truth = Curve(30);
  const auto errors = CompareTrajectories(Moved(truth, kSimilarity, 0.02), truth);
  ASSERT_TRUE(errors.has_value());
  const nlohmann::json json = ToJson(*errors);
  EXPECT_EQ(json["align"], "sim3");
  EXPECT_EQ(json["ate"]["translation"]["rmse"], errors->ate_translation.rmse);
  EXPECT_EQ(json["rpe"]["rotation_deg"]["median"], errors->rpe_rotation_deg.median);
  EXPECT_EQ(json["truth_from_estimate"]["scale"], errors->truth_from_estimate.scale);
  EXPECT_THAT(ToTable(*errors), HasSubstr(fmt::format("{:.6f}", errors->ate_translation.rmse)));
}

TEST(TrajectoryAlignment, NamesRoundTrip) {
  for (const char* name : {"sim3", "se3", "none"}) {
    EXPECT_EQ(TrajectoryAlignmentName(TrajectoryAlignmentFromName(name).value()), name);
  }
  EXPECT_FALSE(TrajectoryAlignmentFromName("SIM3").has_value());
}

}  // namespace
}  // namespace s3lam
