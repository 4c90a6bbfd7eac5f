#include "s3lam/eval/time_offset.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "s3lam/base/rng.h"
#include "s3lam/eval/trajectory_error.h"
#include "s3lam/io/trajectory.h"
#include "support/run_program.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::HasSubstr;

constexpr double kInterval = 0.05;
const Similarity3 kSimilarity{2.5, QuaternionFromRotationVector({0.5, -1.0, 2.0}), {3.0, 1.0, 7.0}};

/// A way with turns and changes of speed.
Rigid3 PoseAt(double time_s) {
  return {QuaternionFromRotationVector({0.2 * time_s, 0.1, -0.3 * time_s}),
          {2.0 * std::cos(time_s), std::sin(1.7 * time_s), 0.3 * std::sin(0.6 * time_s)}};
}

/// Poses of a way at the times i * interval + shift, stamped with i * interval.
template <typename Way>
Trajectory Sampled(const Way& way, int size, double shift) {
  Trajectory trajectory;
  for (int i = 0; i < size; ++i) trajectory.push_back({kInterval * i, way(kInterval * i + shift)});
  return trajectory;
}

/// Adds errors that drift: each remembers nine tenths of the one before.
Trajectory WithDrift(Trajectory trajectory, double sigma, uint64_t seed) {
  Rng rng(seed);
  Eigen::Vector3d drift = Eigen::Vector3d::Zero();
  for (TimedPose& pose : trajectory) {
    drift *= 0.9;
    for (double& coordinate : drift) coordinate += rng.Gaussian(0.0, sigma);
    pose.world_from_camera.translation += drift;
  }
  return trajectory;
}

Trajectory InOtherWorld(Trajectory trajectory) {
  for (TimedPose& pose : trajectory) {
    Rigid3& world_from_camera = pose.world_from_camera;
    world_from_camera.translation = kSimilarity * world_from_camera.translation;
    world_from_camera.rotation = kSimilarity.rotation * world_from_camera.rotation;
  }
  return trajectory;
}

TEST(PoseInterpolator, GoesThroughPosesAndNearTheWayBetweenThem) {
  const Trajectory trajectory = Sampled(PoseAt, 100, 0.0);
  const PoseInterpolator interpolator(trajectory);
  for (const double time_s : {0.0, kInterval, 99 * kInterval}) {
    const auto sample = interpolator.At(time_s);
    ASSERT_TRUE(sample.has_value());
    EXPECT_LT((sample->translation - PoseAt(time_s).translation).norm(), 1e-12);
  }
  const double time_s = 31.4 * kInterval;
  const auto sample = interpolator.At(time_s);
  ASSERT_TRUE(sample.has_value());
  EXPECT_LT((sample->translation - PoseAt(time_s).translation).norm(), 1e-4);
  EXPECT_LT(RotationAngle(sample->rotation, PoseAt(time_s).rotation), 1e-4);
}

TEST(PoseInterpolator, BridgesNoGapAndDoesNotExtrapolate) {
  Trajectory trajectory = Sampled(PoseAt, 40, 0.0);
  trajectory.erase(trajectory.begin() + 10, trajectory.begin() + 14);
  const PoseInterpolator interpolator(trajectory);
  EXPECT_TRUE(interpolator.At(9 * kInterval).has_value());
  EXPECT_FALSE(interpolator.At(11 * kInterval).has_value());
  EXPECT_TRUE(interpolator.At(14 * kInterval).has_value());
  EXPECT_FALSE(interpolator.At(-0.01).has_value());
  EXPECT_FALSE(interpolator.At(39 * kInterval + 0.01).has_value());
  EXPECT_TRUE(interpolator.Covers(0.0, 9 * kInterval));
  EXPECT_TRUE(interpolator.Covers(14 * kInterval, 39 * kInterval));
  EXPECT_FALSE(interpolator.Covers(8 * kInterval, 15 * kInterval));  // Both ends are covered.
  EXPECT_FALSE(interpolator.Covers(-0.01, 9 * kInterval));
  EXPECT_FALSE(PoseInterpolator({}).At(0.0).has_value());
}

TEST(TimeOffset, OfAPerfectEstimateIsExact) {
  const Trajectory truth = Sampled(PoseAt, 300, -0.0353);  // Stamped 35.3 ms late.
  const Trajectory estimate = InOtherWorld(Sampled(PoseAt, 300, 0.0));
  const auto offset = EstimateTimeOffset(estimate, truth, TrajectoryAlignment::kSim3, 0.2);
  ASSERT_TRUE(offset.has_value());
  EXPECT_NEAR(offset->offset_s, 0.0353, 1e-4);
  EXPECT_LT(offset->sigma_s, 1e-4);
}

TEST(TimeOffset, SigmaIsWhatEstimatesScatterByThoughErrorsAreCorrelated) {
  const Trajectory truth = Sampled(PoseAt, 400, -0.02);
  double sum = 0.0;
  constexpr int kNumSeeds = 40;
  for (int seed = 0; seed < kNumSeeds; ++seed) {
    const Trajectory estimate = InOtherWorld(WithDrift(Sampled(PoseAt, 400, 0.0), 0.01, seed));
    const auto offset = EstimateTimeOffset(estimate, truth, TrajectoryAlignment::kSim3, 0.2);
    ASSERT_TRUE(offset.has_value());
    const double deviation = (offset->offset_s - 0.02) / offset->sigma_s;
    sum += deviation * deviation;
  }
  // One, if sigma is true; independent errors would give ten and more.
  EXPECT_GT(sum / kNumSeeds, 0.5);
  EXPECT_LT(sum / kNumSeeds, 2.0);
}

TEST(TimeOffset, OfRotationsIsToldApartFromThatOfPositions) {
  const Eigen::Quaterniond imu_from_camera = QuaternionFromRotationVector({0.3, -1.2, 0.4});
  Trajectory truth = Sampled(PoseAt, 300, -0.0353);
  const Trajectory rotations = Sampled(PoseAt, 300, 0.012);
  for (size_t i = 0; i < truth.size(); ++i) {
    truth[i].world_from_camera.rotation =
        rotations[i].world_from_camera.rotation * imu_from_camera.conjugate();
  }
  const Trajectory estimate = InOtherWorld(WithDrift(Sampled(PoseAt, 300, 0.0), 0.001, 3));
  const auto of_positions = EstimateTimeOffset(estimate, truth, TrajectoryAlignment::kSim3, 0.2);
  ASSERT_TRUE(of_positions.has_value());
  EXPECT_NEAR(of_positions->offset_s, 0.0353, 5.0 * of_positions->sigma_s);
  const auto of_rotations = EstimateTimeOffsetOfRotations(estimate, truth, 0.2);
  ASSERT_TRUE(of_rotations.has_value());
  EXPECT_NEAR(of_rotations->offset_s, -0.012, 2e-3);
  EXPECT_LT(of_rotations->sigma_s, 2e-3);
}

TEST(TimeOffset, OfRotationsIsNotToldByNone) {
  const auto straight = [](double time_s) {
    return Rigid3{Eigen::Quaterniond::Identity(), {time_s * time_s, std::sin(time_s), 0.0}};
  };
  const Trajectory estimate = Sampled(straight, 200, 0.0);
  EXPECT_FALSE(EstimateTimeOffsetOfRotations(estimate, estimate, 0.2).has_value());
  EXPECT_FALSE(EstimateTimeOffsetOfRotations({}, {}, 0.2).has_value());
}

TEST(TimeOffset, IsNotToldByAMotionThatAnAlignmentExplains) {
  const auto circle = [](double time_s) {
    return Rigid3{Eigen::Quaterniond::Identity(), {std::cos(time_s), std::sin(time_s), 0.0}};
  };
  const Trajectory truth = Sampled(circle, 200, -0.03);
  const Trajectory estimate = Sampled(circle, 200, 0.0);
  EXPECT_FALSE(EstimateTimeOffset(estimate, truth, TrajectoryAlignment::kSim3, 0.2).has_value());
  const auto offset = EstimateTimeOffset(estimate, truth, TrajectoryAlignment::kNone, 0.2);
  ASSERT_TRUE(offset.has_value());
  EXPECT_NEAR(offset->offset_s, 0.03, 1e-4);
}

TEST(TimeOffset, BeyondTheLimitIsNotFound) {
  const Trajectory truth = Sampled(PoseAt, 300, -0.5);
  const Trajectory estimate = Sampled(PoseAt, 300, 0.0);
  EXPECT_FALSE(EstimateTimeOffset(estimate, truth, TrajectoryAlignment::kSim3, 0.2).has_value());
  EXPECT_TRUE(EstimateTimeOffset(estimate, truth, TrajectoryAlignment::kSim3, 1.0).has_value());
}

TEST(TimeOffset, ErrorsAreToldWithoutAndWithIt) {
  const Trajectory truth = Sampled(PoseAt, 300, -0.03);
  const Trajectory estimate = InOtherWorld(Sampled(PoseAt, 300, 0.0));
  const auto plain = CompareTrajectories(estimate, truth);
  ASSERT_TRUE(plain.has_value());
  EXPECT_FALSE(plain->time_offset.has_value());
  EXPECT_TRUE(ToJson(*plain)["time_offset"].is_null());
  TrajectoryErrorOptions given;
  given.time_offset_s = 0.03;
  TrajectoryErrorOptions estimated;
  estimated.estimate_time_offset = true;
  for (const TrajectoryErrorOptions& options : {given, estimated}) {
    const auto errors = CompareTrajectories(estimate, truth, options);
    ASSERT_TRUE(errors.has_value());
    EXPECT_GT(plain->ate_translation.rmse, 0.03);
    EXPECT_LT(errors->ate_translation.rmse, 1e-3);
    EXPECT_LT(errors->ate_rotation_deg.max, 0.1);
    EXPECT_EQ(errors->num_pairs, 299u);  // The truth ends before the last pose.
    const nlohmann::json json = ToJson(*errors)["time_offset"];
    EXPECT_EQ(json["estimated"], options.estimate_time_offset);
    EXPECT_NEAR(json["seconds"].get<double>(), 0.03, 1e-4);
    EXPECT_EQ(json["sigma_s"].is_null(), !options.estimate_time_offset);
    EXPECT_EQ(json["without"]["num_pairs"], 300);
    EXPECT_NEAR(json["without"]["ate_rmse"].get<double>(), plain->ate_translation.rmse, 1e-12);
    // Nothing but the offset is wrong, so that exact poses do no better without it.
    EXPECT_NEAR(json["exact_poses_without"]["ate_rmse"].get<double>(), plain->ate_translation.rmse,
                1e-2 * plain->ate_translation.rmse);
    EXPECT_EQ(json["of_rotations"].is_null(), !options.estimate_time_offset);
    EXPECT_THAT(ToTable(*errors), HasSubstr("without it 300 poses"));
  }
}

TEST(TimeOffset, ThatCannotBeToldIsNotApplied) {
  const Trajectory truth = Sampled(PoseAt, 300, -0.5);
  const Trajectory estimate = Sampled(PoseAt, 300, 0.0);
  TrajectoryErrorOptions options;
  options.estimate_time_offset = true;
  const auto errors = CompareTrajectories(estimate, truth, options);
  ASSERT_TRUE(errors.has_value());
  EXPECT_TRUE(ToJson(*errors)["time_offset"]["seconds"].is_null());
  EXPECT_EQ(errors->ate_translation.rmse,
            CompareTrajectories(estimate, truth)->ate_translation.rmse);
  EXPECT_THAT(ToTable(*errors), HasSubstr("cannot be told"));
}

TEST(TimeOffset, OnTheCommandLine) {
  const testing::TempDir dir;
  WriteTumTrajectory(Sampled(PoseAt, 300, -0.03), dir / "truth.txt");
  WriteTumTrajectory(Sampled(PoseAt, 300, 0.0), dir / "estimate.txt");
  const auto run = [&](const std::string& offset) {
    return testing::RunProgramApart({std::string(S3LAM_TEST_BIN_DIR) + "/s3-eval", "--quiet",
                                     "--json", "--estimate", (dir / "estimate.txt").string(),
                                     "--ground-truth", (dir / "truth.txt").string(),
                                     "--time-offset", offset});
  };
  for (const char* offset : {"auto", "0.03"}) {
    const auto report = nlohmann::json::parse(run(offset).output)["trajectory"];
    EXPECT_NEAR(report["time_offset"]["seconds"].get<double>(), 0.03, 1e-4);
  }
  for (const char* wrong : {"automatic", "0.03s", "", "nan"}) EXPECT_EQ(run(wrong).exit_code, 2);
}

}  // namespace
}  // namespace s3lam
