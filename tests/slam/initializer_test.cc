#include "s3lam/slam/initializer.h"

#include <gtest/gtest.h>

#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

class InitializerTest : public ::testing::Test {
 protected:
  InitializerTest() : undistorter_(testing::MakeTestCamera(CameraModel::kSimpleRadial)) {}

  /// Frames with steps of `translation` and `rotation` each, half a pixel of noise.
  std::vector<FrameFeatures> MakeFrames(bool planar, const Eigen::Vector3d& translation,
                                        const Eigen::Vector3d& rotation) {
    Rng rng(8);
    const testing::PointCloud cloud = testing::MakeCloud(600, planar, 9);
    std::vector<FrameFeatures> frames;
    for (int i = 0; i < 25; ++i) {
      const Rigid3 pose{QuaternionFromRotationVector(i * rotation), i * translation};
      poses_.push_back(pose);
      frames.push_back(testing::SeeCloud(cloud, pose, undistorter_, 0.5, rng));
    }
    return frames;
  }

  void ExpectRightMotion(const InitialPair& pair) {
    const Rigid3 truth = poses_[pair.frame_b] * poses_[pair.frame_a].Inverse();
    EXPECT_LT(RotationAngle(pair.b_from_a.rotation, truth.rotation), 0.01);
    EXPECT_GT(pair.b_from_a.translation.normalized().dot(truth.translation.normalized()), 0.99);
  }

  Undistorter undistorter_;
  std::vector<Rigid3> poses_;
};

TEST_F(InitializerTest, FindsTheMotionInAGeneralScene) {
  const auto frames = MakeFrames(false, {0.05, 0.01, 0.01}, {0.0, 0.005, 0.0});
  const auto pair = FindInitialPair({}, frames, undistorter_, 1);
  ASSERT_TRUE(pair.has_value());
  EXPECT_GE(pair->points.size(), 150U);
  EXPECT_GE(pair->parallax_deg, 1.0);
  EXPECT_EQ(pair->num_other_motions, 0);
  ExpectRightMotion(*pair);
}

TEST_F(InitializerTest, SettlesThePlanarAmbiguity) {
  const auto frames = MakeFrames(true, {0.05, 0.0, 0.03}, {0.004, 0.004, 0.0});
  const auto pair = FindInitialPair({}, frames, undistorter_, 1);
  ASSERT_TRUE(pair.has_value());
  EXPECT_EQ(pair->num_other_motions, 1);
  EXPECT_GT(pair->other_error, pair->mean_squared_error);
  EXPECT_LT(pair->other_error, pair->rotation_only_error);
  ExpectRightMotion(*pair);
}

TEST_F(InitializerTest, StartsOnAFastStraightDrive) {
  // Far points, which stay in sight and hardly move, outnumber near ones; the sequence is short.
  Rng rng(8);
  testing::PointCloud cloud;
  for (int i = 0; i < 1500; ++i) {
    const double side = rng.Below(2) == 0 ? -1.0 : 1.0;
    cloud.points.emplace_back(side * rng.Uniform(3.0, 8.0), rng.Uniform(-2.0, 1.5),
                              rng.Uniform(5.0, 120.0));
    cloud.descriptors.push_back(testing::MakeDescriptor(rng));
  }
  std::vector<FrameFeatures> frames;
  for (int i = 0; i < 12; ++i) {
    poses_.push_back({Eigen::Quaterniond::Identity(), {0.0, 0.0, -0.8 * i}});
    frames.push_back(testing::SeeCloud(cloud, poses_.back(), undistorter_, 0.5, rng));
  }
  const auto pair = FindInitialPair({}, frames, undistorter_, 1);
  ASSERT_TRUE(pair.has_value());
  EXPECT_LT(pair->parallax_deg, InitializerOptions().min_parallax_deg);
  ExpectRightMotion(*pair);
}

TEST_F(InitializerTest, StartsWhereThreeImagesOverlapByThreeQuarters) {
  Rng rng(8);
  testing::PointCloud cloud;
  for (int i = 0; i < 1500; ++i) {
    cloud.points.emplace_back(rng.Uniform(-3.0, 6.0), rng.Uniform(-2.0, 2.0),
                              rng.Uniform(3.5, 5.0));
    cloud.descriptors.push_back(testing::MakeDescriptor(rng));
  }
  std::vector<FrameFeatures> frames;
  for (int i = 0; i < 3; ++i) {  // The second step is turned as well, as a drone in gusts is.
    const Eigen::Vector3d turn(i == 2 ? 0.05 : 0.0, 0.0, 0.0);
    poses_.push_back({QuaternionFromRotationVector(turn), {-1.3 * i, 0.0, 0.0}});
    frames.push_back(testing::SeeCloud(cloud, poses_.back(), undistorter_, 0.5, rng));
  }
  const auto pair = FindInitialPair({}, frames, undistorter_, 1);
  ASSERT_TRUE(pair.has_value());
  EXPECT_EQ(pair->frame_b - pair->frame_a, 2);
  ExpectRightMotion(*pair);
}

TEST_F(InitializerTest, RefusesImagesOfDifferentPlaces) {
  Rng rng(8);
  std::vector<FrameFeatures> frames;
  for (uint64_t i = 0; i < 8; ++i) {
    frames.push_back(testing::SeeCloud(testing::MakeCloud(600, /*planar=*/false, i), {},
                                       undistorter_, 0.5, rng));
  }
  EXPECT_FALSE(FindInitialPair({}, frames, undistorter_, 1).has_value());
}

TEST_F(InitializerTest, RefusesARotationByAQuarterOfTheImageEach) {
  const auto frames = MakeFrames(false, Eigen::Vector3d::Zero(), {0.0, 0.25, 0.0});
  EXPECT_FALSE(FindInitialPair({}, frames, undistorter_, 1).has_value());
}

TEST_F(InitializerTest, RefusesAPureRotation) {
  const auto frames = MakeFrames(false, Eigen::Vector3d::Zero(), {0.002, 0.012, 0.0});
  EXPECT_FALSE(FindInitialPair({}, frames, undistorter_, 1).has_value());
}

TEST_F(InitializerTest, RefusesAStandstill) {
  const auto frames = MakeFrames(false, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  EXPECT_FALSE(FindInitialPair({}, frames, undistorter_, 1).has_value());
}

}  // namespace
}  // namespace s3lam
