#include <gtest/gtest.h>

#include <algorithm>

#include "s3lam/base/rng.h"
#include "s3lam/robust/absolute_pose.h"
#include "s3lam/robust/relative_pose.h"

namespace s3lam {
namespace {

const Rigid3 kPose{QuaternionFromRotationVector({0.05, -0.2, 0.1}), {0.6, -0.1, 0.05}};

std::vector<Eigen::Vector3d> MakePoints(int count, bool planar, Rng& rng) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) {
    const double x = rng.Uniform(-2, 2);
    const double y = rng.Uniform(-1.5, 1.5);
    points.emplace_back(x, y, planar ? 4.0 + 0.3 * x : rng.Uniform(3, 8));
  }
  return points;
}

class Seeds : public ::testing::TestWithParam<uint64_t> {};
INSTANTIATE_TEST_SUITE_P(PoseEstimators, Seeds, ::testing::Values(0, 1, 2));

TEST_P(Seeds, FindAPoseAmongWrongMatches) {
  Rng rng(1);
  const auto points = MakePoints(80, false, rng);
  std::vector<Eigen::Vector2d> seen;
  for (const auto& x : points) seen.push_back((kPose * x).hnormalized());
  for (size_t i = 0; i < 30; ++i) seen[i] = {rng.Uniform(-0.6, 0.6), rng.Uniform(-0.5, 0.5)};
  const auto pose = EstimateAbsolutePose(points, seen, 0.004, GetParam());
  ASSERT_TRUE(pose.has_value());
  EXPECT_GE(pose->num_inliers, 50);
  for (size_t i = 30; i < 80; ++i) EXPECT_EQ(pose->is_inlier[i], 1) << i;
  EXPECT_LT((pose->cam_from_world.CenterInB() - kPose.CenterInB()).norm(), 0.01);
}

TEST(AbsolutePose, IsEmptyWithoutEnoughPoints) {
  const std::vector<Eigen::Vector3d> points(3, Eigen::Vector3d::Ones());
  const std::vector<Eigen::Vector2d> seen(3, Eigen::Vector2d::Zero());
  EXPECT_FALSE(EstimateAbsolutePose(points, seen, 0.01, 0).has_value());
}

/// Candidates for kPose from matches that are off by `noise` at the most, in b.
std::vector<Rigid3> Candidates(bool planar, double noise, uint64_t seed) {
  Rng rng(2);
  std::vector<Eigen::Vector2d> a;
  std::vector<Eigen::Vector2d> b;
  for (const auto& x : MakePoints(150, planar, rng)) {
    a.push_back(x.hnormalized());
    b.push_back((kPose * x).hnormalized() +
                Eigen::Vector2d(rng.Uniform(-noise, noise), rng.Uniform(-noise, noise)));
  }
  return RelativePoseCandidates(a, b, 0.003, seed);
}

class RelativePoseCandidatesTest : public ::testing::TestWithParam<bool> {};

TEST_P(RelativePoseCandidatesTest, HoldTheTrueMotion) {
  for (const uint64_t seed : {0, 1, 2}) {
    const auto candidates = Candidates(GetParam(), 0.0, seed);
    const bool found = std::any_of(candidates.begin(), candidates.end(), [](const Rigid3& c) {
      return RotationAngle(c.rotation, kPose.rotation) < 0.01 &&
             c.translation.dot(kPose.translation.normalized()) > 0.999;
    });
    EXPECT_TRUE(found) << candidates.size() << " candidates, seed " << seed;
  }
}

TEST_P(RelativePoseCandidatesTest, DependOnTheSeedWhereMatchesAreNotExact) {
  const auto first = [](uint64_t seed) {
    return Candidates(GetParam(), 0.002, seed).front().translation;
  };
  EXPECT_EQ(first(0), first(0));
  EXPECT_EQ(first(1), first(1));
  EXPECT_NE(first(0), first(1));
}

INSTANTIATE_TEST_SUITE_P(Scenes, RelativePoseCandidatesTest, ::testing::Values(false, true),
                         [](const auto& test) { return test.param ? "planar" : "general"; });

}  // namespace
}  // namespace s3lam
