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

TEST(AbsolutePose, FindsAPoseAmongWrongMatches) {
  Rng rng(1);
  const auto points = MakePoints(80, false, rng);
  std::vector<Eigen::Vector2d> seen;
  for (const auto& x : points) seen.push_back((kPose * x).hnormalized());
  for (size_t i = 0; i < 30; ++i) seen[i] = {rng.Uniform(-0.6, 0.6), rng.Uniform(-0.5, 0.5)};
  const auto pose = EstimateAbsolutePose(points, seen, 0.004);
  ASSERT_TRUE(pose.has_value());
  EXPECT_GE(pose->num_inliers, 50);
  EXPECT_LT((pose->cam_from_world.CenterInB() - kPose.CenterInB()).norm(), 0.01);
}

TEST(AbsolutePose, IsEmptyWithoutEnoughPoints) {
  const std::vector<Eigen::Vector3d> points(3, Eigen::Vector3d::Ones());
  const std::vector<Eigen::Vector2d> seen(3, Eigen::Vector2d::Zero());
  EXPECT_FALSE(EstimateAbsolutePose(points, seen, 0.01).has_value());
}

class RelativePoseCandidatesTest : public ::testing::TestWithParam<bool> {};

TEST_P(RelativePoseCandidatesTest, HoldTheTrueMotion) {
  Rng rng(2);
  const auto points = MakePoints(150, GetParam(), rng);
  std::vector<Eigen::Vector2d> a;
  std::vector<Eigen::Vector2d> b;
  for (const auto& x : points) {
    a.push_back(x.hnormalized());
    b.push_back((kPose * x).hnormalized());
  }
  const auto candidates = RelativePoseCandidates(a, b, 0.003);
  const bool found = std::any_of(candidates.begin(), candidates.end(), [](const Rigid3& c) {
    return RotationAngle(c.rotation, kPose.rotation) < 0.01 &&
           c.translation.dot(kPose.translation.normalized()) > 0.999;
  });
  EXPECT_TRUE(found) << candidates.size() << " candidates";
}

INSTANTIATE_TEST_SUITE_P(Scenes, RelativePoseCandidatesTest, ::testing::Values(false, true),
                         [](const auto& test) { return test.param ? "planar" : "general"; });

}  // namespace
}  // namespace s3lam
