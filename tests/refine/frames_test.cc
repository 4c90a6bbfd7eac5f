#include "s3lam/refine/frames.h"

#include <gtest/gtest.h>

#include "s3lam/geometry/similarity3.h"

namespace s3lam {
namespace {

Rigid3 PoseAt(double x, double angle) {
  const Eigen::Quaterniond rotation = QuaternionFromRotationVector({0.0, angle, 0.1 * angle});
  return {rotation, -(rotation * Eigen::Vector3d(x, 0.2 * x, -x * x))};
}

std::vector<MovedKeyframe> Keyframes(const Similarity3& new_from_old) {
  std::vector<MovedKeyframe> keyframes;
  for (const double time : {4.0, 0.0, 2.0}) {  // In no particular order.
    const Rigid3 pose = PoseAt(time, 0.1 * time);
    keyframes.push_back({time, pose, TransformCameraPose(new_from_old, pose)});
  }
  return keyframes;
}

TEST(CarryFrames, FollowsASimilarity) {
  // If the keyframes move as one rigid, scaled whole, so do the frames between them.
  const Similarity3 new_from_old{
      1.3, QuaternionFromRotationVector({0.2, -0.1, 0.4}), {1.0, 2.0, 3.0}};
  Trajectory frames;
  for (const double time : {0.0, 0.7, 1.9, 2.0, 3.3, 4.0}) {
    frames.push_back({time, PoseAt(time, 0.1 * time).Inverse()});
  }
  const auto keyframes = Keyframes(new_from_old);
  const Trajectory carried = CarryFrames(frames, keyframes);
  ASSERT_EQ(carried.size(), frames.size());
  for (size_t i = 0; i < frames.size(); ++i) {
    const Rigid3 expected =
        TransformCameraPose(new_from_old, frames[i].world_from_camera.Inverse()).Inverse();
    EXPECT_LT((carried[i].world_from_camera.translation - expected.translation).norm(), 1e-9);
    EXPECT_LT(RotationAngle(carried[i].world_from_camera.rotation, expected.rotation), 1e-9);
    EXPECT_EQ(carried[i].time_s, frames[i].time_s);
  }
}

TEST(CarryFrames, BeyondTheKeyframesTheNearestOneCounts) {
  const Similarity3 shift{1.0, Eigen::Quaterniond::Identity(), {0.0, 0.0, 5.0}};
  const Trajectory frames{{-3.0, PoseAt(-1.0, 0.0).Inverse()}, {9.0, PoseAt(5.0, 0.0).Inverse()}};
  const auto keyframes = Keyframes(shift);
  const Trajectory carried = CarryFrames(frames, keyframes);
  for (size_t i = 0; i < frames.size(); ++i) {
    const Eigen::Vector3d moved =
        carried[i].world_from_camera.translation - frames[i].world_from_camera.translation;
    EXPECT_LT((moved - Eigen::Vector3d(0.0, 0.0, 5.0)).norm(), 1e-12);
  }
}

TEST(CarryFrames, WithoutKeyframesNothingMoves) {
  const Trajectory frames{{1.0, PoseAt(1.0, 0.3).Inverse()}};
  const Trajectory carried = CarryFrames(frames, {});
  EXPECT_EQ(carried[0].world_from_camera.translation, frames[0].world_from_camera.translation);
}

}  // namespace
}  // namespace s3lam
