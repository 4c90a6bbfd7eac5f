#include "s3lam/slam/two_view_check.h"

#include <gtest/gtest.h>

#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

/// A camera moving sideways past a cloud of points, a keyframe at every step.
class TwoViewCheckTest : public ::testing::Test {
 protected:
  TwoViewCheckTest() : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)) {
    const testing::PointCloud cloud = testing::MakeCloud(400, /*planar=*/false, 5);
    Rng rng(6);
    for (int i = 0; i < kFrames; ++i) {
      Rigid3 pose;
      pose.translation = Eigen::Vector3d(-0.15 * i, 0.02 * i, 0.0);
      truth_.push_back(pose);
      frames_.push_back(testing::SeeCloud(cloud, pose, undistorter_, 0.3, rng));
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
