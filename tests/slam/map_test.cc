#include "s3lam/slam/map.h"

#include <gtest/gtest.h>

#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

class MapTest : public ::testing::Test {
 protected:
  MapTest() : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)) {
    Rng rng(1);
    const testing::PointCloud cloud = testing::MakeCloud(50, false, 2);
    for (int i = 0; i < 3; ++i) {
      poses_.push_back({Eigen::Quaterniond::Identity(), {0.1 * i, 0.0, 0.0}});
      frames_.push_back(testing::SeeCloud(cloud, poses_.back(), undistorter_, 0.0, rng));
    }
  }

  /// Three keyframes that all see points 0 .. 9 with keypoints of the same numbers.
  Map MakeMap() {
    Map map(frames_, {});
    for (int i = 0; i < 3; ++i) map.AddKeyframe(i, poses_[i]);
    for (int p = 0; p < 10; ++p) {
      map.AddPoint({0.1 * p, 0.0, 4.0}, 0);
      for (int k = 0; k < 3; ++k) EXPECT_TRUE(map.AddObservation(p, {k, p}));
      map.UpdateAppearance(p);
      map.UpdateGeometry(p);
    }
    return map;
  }

  Undistorter undistorter_;
  std::vector<Rigid3> poses_;
  std::vector<FrameFeatures> frames_;
};

TEST_F(MapTest, ObservationsAreUniqueBothWays) {
  Map map = MakeMap();
  EXPECT_FALSE(map.AddObservation(0, {1, 20}));  // The keyframe sees it already.
  const int other = map.AddPoint({0.0, 0.0, 5.0}, 0);
  EXPECT_FALSE(map.AddObservation(other, {1, 3}));  // The keypoint is taken.
  EXPECT_TRUE(map.AddObservation(other, {1, 20}));
  EXPECT_EQ(map.keyframe(1).point_of_keypoint[20], other);
}

TEST_F(MapTest, APointGoesWithItsLastButOneObservation) {
  Map map = MakeMap();
  map.RemoveObservation(4, 0);
  EXPECT_TRUE(map.point(4).alive);
  map.RemoveObservation(4, 2);
  EXPECT_FALSE(map.point(4).alive);
  for (int k = 0; k < 3; ++k) EXPECT_EQ(map.keyframe(k).point_of_keypoint[4], kNoIndex);
  EXPECT_EQ(map.Resolve(4), kNoIndex);
}

TEST_F(MapTest, MergedPointsAreFoundByTheirOldName) {
  Map map = MakeMap();
  map.RemoveObservation(1, 2);
  map.RemoveObservation(2, 0);
  map.MergePoints(1, 2);
  EXPECT_EQ(map.Resolve(2), 1);
  ASSERT_EQ(map.point(1).observations.size(), 3U);
  EXPECT_EQ(map.keyframe(2).point_of_keypoint[2], 1);         // Came over,
  EXPECT_EQ(map.keyframe(1).point_of_keypoint[2], kNoIndex);  // collided: dropped.
}

TEST_F(MapTest, CovisibilityCountsSharedPoints) {
  Map map = MakeMap();
  map.RemoveObservation(7, 2);
  const auto covisible = map.Covisible(0);
  ASSERT_EQ(covisible.size(), 2U);
  EXPECT_EQ(covisible[0], (std::pair<int, int>(10, 1)));
  EXPECT_EQ(covisible[1], (std::pair<int, int>(9, 2)));
}

TEST_F(MapTest, AnErasedKeyframeMovesWithItsNeighbour) {
  Map map = MakeMap();
  map.EraseKeyframe(1);
  EXPECT_FALSE(map.keyframe(1).alive);
  EXPECT_EQ(map.point(0).observations.size(), 2U);
  const Rigid3 before = map.PoseOf(1);
  EXPECT_LT((before.translation - poses_[1].translation).norm(), 1e-12);
  const int anchor = map.keyframe(1).anchor;
  Rigid3 moved = map.keyframe(anchor).cam_from_world;
  moved.translation += Eigen::Vector3d(0.0, 1.0, 0.0);
  map.SetPose(anchor, moved);
  EXPECT_NEAR(map.PoseOf(1).translation.y(), 1.0, 1e-12);
}

TEST_F(MapTest, WeakKeyframesAreErasedTheWeakestFirst) {
  Map map = MakeMap();
  for (int p = 0; p < 7; ++p) map.RemoveObservation(p, 1);
  for (int p = 5; p < 8; ++p) map.RemoveObservation(p, 2);
  EXPECT_EQ(map.EraseWeakKeyframes(3), 0);
  EXPECT_EQ(map.EraseWeakKeyframes(5), 1);
  EXPECT_EQ(map.AliveKeyframes(), (std::vector<int>{0, 2}));
  EXPECT_EQ(map.EraseWeakKeyframes(1000), 0);  // Two are left in any case.
}

}  // namespace
}  // namespace s3lam
