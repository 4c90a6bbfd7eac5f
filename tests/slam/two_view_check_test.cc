#include "s3lam/slam/two_view_check.h"

#include <gtest/gtest.h>

#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

/// A camera moving sideways past a cloud of points, a keyframe at every step.
class TwoViewCheckTest : public ::testing::Test {
 protected:
  TwoViewCheckTest() : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)) {
    Rng rng(6);
    for (int i = 0; i < kFrames; ++i) {
      Rigid3 pose;
      pose.translation = Eigen::Vector3d(-0.15 * i, 0.02 * i, 0.0);
      truth_.push_back(pose);
      frames_.push_back(testing::SeeCloud(cloud_, pose, undistorter_, 0.3, rng));
    }
  }

  /// Keyframes at these poses.
  std::vector<TwoViewCheck> Check(const std::vector<Rigid3>& poses, int num_threads = 1) {
    std::vector<FrameFeatures> frames = frames_;
    Map map(frames, FeatureOptions{});
    for (int i = 0; i < kFrames; ++i) map.AddKeyframe(i, poses[static_cast<size_t>(i)]);
    return CheckTwoViews({}, map, undistorter_, num_threads);
  }

  static constexpr int kFrames = 6;
  const testing::PointCloud cloud_ = testing::MakeCloud(400, /*planar=*/false, 5);
  Undistorter undistorter_;
  std::vector<Rigid3> truth_;
  std::vector<FrameFeatures> frames_;
};

TEST_F(TwoViewCheckTest, ATrueMapIsNotContradicted) {
  const std::vector<TwoViewCheck> checks = Check(truth_);
  ASSERT_EQ(checks.size(), 6U);  // Four pairs two keyframes apart, two pairs four apart.
  for (const TwoViewCheck& check : checks) {
    EXPECT_GT(check.num_matches, 100);
    EXPECT_GT(check.num_of_map, 90 * check.num_matches / 100);
    EXPECT_EQ(check.Contradiction(), 0.0) << check.frame_a << " and " << check.frame_b;
  }
}

TEST_F(TwoViewCheckTest, AWrongTurnIsContradictedAroundItAndOnlyThere) {
  std::vector<Rigid3> bent = truth_;
  const Rigid3 turn{Eigen::Quaterniond(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitX())),
                    Eigen::Vector3d::Zero()};
  for (size_t i = 4; i < bent.size(); ++i) bent[i] = turn * bent[i];
  const std::vector<TwoViewCheck> checks = Check(bent);
  for (const TwoViewCheck& check : checks) {
    EXPECT_EQ(check.Contradiction() > 0.1, check.frame_a < 4 && check.frame_b >= 4)
        << check.frame_a << " and " << check.frame_b;
  }
  const std::vector<double> of_frames = ContradictionOfFrames(checks, kFrames);
  ASSERT_EQ(of_frames.size(), static_cast<size_t>(kFrames));
  EXPECT_GT(of_frames[3], 0.1);
  EXPECT_GT(of_frames[5], 0.1);
}

/// A wall fits many motions, of which one fits much of what is burnt into a corner as well.
TEST_F(TwoViewCheckTest, WhatIsBurntIntoTheImagesDoesNotContradict) {
  const testing::PointCloud wall = testing::MakeCloud(150, /*planar=*/true, 5);
  const testing::PointCloud burnt = testing::MakeCloud(70, /*planar=*/true, 9);
  Rng rng(6);
  for (size_t i = 0; i < truth_.size(); ++i) {
    const double angle = 0.03 * static_cast<double>(i);
    truth_[i].rotation = Eigen::AngleAxisd(angle, Eigen::Vector3d(1.0, 1.0, 1.0).normalized());
    testing::PointCloud all = wall;
    for (size_t p = 0; p < burnt.points.size(); ++p) {
      const Eigen::Vector3d corner(-1.2, -0.8, 4.0);
      all.points.emplace_back(truth_[i].Inverse() * (corner + 0.1 * burnt.points[p]));
      all.descriptors.push_back(burnt.descriptors[p]);
    }
    frames_[i] = testing::SeeCloud(all, truth_[i], undistorter_, 0.1, rng);
  }
  const std::vector<TwoViewCheck> checks = Check(truth_);
  EXPECT_EQ(checks.size(), 6U);
  for (const TwoViewCheck& check : checks) EXPECT_EQ(check.Contradiction(), 0.0);
}

/// A row of things of one kind: what a later keyframe sees at one of them looks like what an
/// earlier one saw at the one before.
class RepeatedThingsTest : public ::testing::Test {
 protected:
  static constexpr int kFrames = 5;  // Looks are the next thing's from the middle one on.

  RepeatedThingsTest() : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)) {
    early_ = testing::MakeCloud(150, /*planar=*/false, 5);
    const testing::PointCloud next = testing::MakeCloud(150, /*planar=*/false, 7);
    late_ = early_;
    for (size_t i = 0; i < next.points.size(); ++i) {
      early_.points.emplace_back(early_.points[i] + Eigen::Vector3d(0.4, 0.3, 0.2));
      early_.descriptors.push_back(next.descriptors[i]);
    }
    late_.points = early_.points;
    late_.descriptors.insert(late_.descriptors.begin(), next.descriptors.rbegin(),
                             next.descriptors.rend());
    Rng rng(6);
    for (int i = 0; i < kFrames; ++i) {
      frames_.push_back(
          testing::SeeCloud(i < kFrames / 2 ? early_ : late_, Pose(i), undistorter_, 0.3, rng));
    }
  }

  static Rigid3 Pose(int frame) {
    Rigid3 pose;
    pose.translation = Eigen::Vector3d(-0.1 * frame, 0.02 * frame, 0.0);
    return pose;
  }

  /// The right map: true poses and points.
  Map TrueMap() {
    Map map(frames_, FeatureOptions{});
    for (int i = 0; i < kFrames; ++i) map.AddKeyframe(i, Pose(i));
    for (size_t p = 0; p < early_.points.size(); ++p) {
      const int point = map.AddPoint(early_.points[p], 0);
      for (int i = 0; i < kFrames; ++i) {
        const auto& looks = (i < kFrames / 2 ? early_ : late_).descriptors[p];
        for (int k = 0; k < frames_[static_cast<size_t>(i)].size(); ++k) {
          if (frames_[static_cast<size_t>(i)].descriptor(k) == looks) {
            map.AddObservation(point, {i, k});
          }
        }
      }
    }
    return map;
  }

  Undistorter undistorter_;
  testing::PointCloud early_;
  testing::PointCloud late_;
  std::vector<FrameFeatures> frames_;
};

TEST_F(RepeatedThingsTest, ContradictOnlyAMapThatDoesNotSeeThemApart) {
  Map without_points(frames_, FeatureOptions{});
  for (int i = 0; i < kFrames; ++i) without_points.AddKeyframe(i, Pose(i));
  EXPECT_GT(ContradictionOfFrames(CheckTwoViews({}, without_points, undistorter_, 1), kFrames)[1],
            0.5);
  const std::vector<TwoViewCheck> checks = CheckTwoViews({}, TrueMap(), undistorter_, 1);
  EXPECT_EQ(ContradictionOfFrames(checks, kFrames), std::vector<double>(kFrames, 0.0));
  ASSERT_EQ(checks.size(), 1U);  // Where looks stay.
  EXPECT_EQ(checks[0].frame_a, kFrames / 2);
}

TEST_F(TwoViewCheckTest, IsTheSameOnAnyNumberOfThreads) {
  const auto one = Check(truth_, 1);
  const auto three = Check(truth_, 3);
  ASSERT_EQ(one.size(), three.size());
  for (size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].num_of_map, three[i].num_of_map);
    EXPECT_EQ(one[i].num_of_best, three[i].num_of_best);
  }
}

TEST(TwoViewCheck, AFewMatchesMoreAreChance) {
  EXPECT_EQ((TwoViewCheck{0, 1, 40, 31, 35}.Contradiction()), 0.0);
  EXPECT_NEAR((TwoViewCheck{0, 1, 400, 300, 350}.Contradiction()), 45.0 / 350.0, 1e-12);
  EXPECT_EQ((TwoViewCheck{}.Contradiction()), 0.0);
}

}  // namespace
}  // namespace s3lam
