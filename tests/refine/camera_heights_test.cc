#include "s3lam/refine/camera_heights.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace s3lam {
namespace {

/// Cameras at height one over level ground planes, each of a square of exact points.
struct Drive {
  CameraHeightOptions options;
  PlaneSigmaOptions sigma;
  PlaneModel model;
  BundleProblem problem;

  explicit Drive(const std::vector<double>& ground) {
    for (size_t k = 0; k < ground.size(); ++k) AddStretch(10.0 * static_cast<double>(k), ground[k]);
  }

  void AddStretch(double x, double z) {
    const int plane = static_cast<int>(model.planes.size());
    PlaneState state;
    state.is_ground = true;
    state.kappa = 1.0;
    for (int i = 0; i < 25; ++i) {
      state.members.push_back(static_cast<int>(problem.points.size()));
      problem.points.emplace_back(x + i % 5, i / 5 - 2.0, z);
      model.keypoint_size.push_back(1e-3);
      model.covariances.emplace_back(1e-6 * Eigen::Matrix3d::Identity());
    }
    model.planes.push_back(state);
    problem.planes.push_back(AnchoredPlane::FromPlane({Eigen::Vector3d::UnitZ(), -z}, {x, 0, z}));
    for (int i = 0; i < 3; ++i) {
      problem.heights.push_back({static_cast<int>(problem.poses.size()), plane, 0.01});
      problem.poses.push_back(ToPoseBlock(Rigid3{Eigen::Quaterniond::Identity(), {-x - i, 0, -1}}));
    }
  }

  /// As if a solve had moved the points of a plane.
  void MoveGround(int plane, double z) {
    for (const int i : model.planes[plane].members) problem.points[i].z() = z;
  }

  [[nodiscard]] size_t NumHeightsOver(int plane) const {
    return static_cast<size_t>(
        std::count_if(problem.heights.begin(), problem.heights.end(),
                      [&](const HeightTerm& term) { return term.plane == plane; }));
  }
};

TEST(CameraHeights, WhatCanBeExplainedKeepsItsWeight) {
  Drive drive({0.0, 0.008, -0.008, 0.0});
  CameraHeights heights(drive.options, drive.sigma, 1.0);
  for (int round = 0; round < 3; ++round) heights.Update(drive.model, drive.problem);
  EXPECT_TRUE(heights.Settled());
  EXPECT_TRUE(heights.Doubts().empty());
  EXPECT_EQ(drive.model.ground_strength, 1.0);
  EXPECT_EQ(drive.problem.heights.front().sigma_relative, 0.01);
}

TEST(CameraHeights, WeightsRiseUntilTheMapFollows) {
  Drive drive({-0.1, 0.0, 0.0, 0.1});
  CameraHeights heights(drive.options, drive.sigma, 1.0);
  heights.Update(drive.model, drive.problem);
  const double first = drive.model.ground_strength;
  EXPECT_GT(first, 2.0);
  EXPECT_DOUBLE_EQ(drive.problem.heights.front().sigma_relative, 0.01 / first);
  for (const double left : {0.05, 0.005}) {
    EXPECT_FALSE(heights.Settled());
    drive.MoveGround(0, -left);
    drive.MoveGround(3, left);
    heights.Update(drive.model, drive.problem);
  }
  EXPECT_GT(drive.model.ground_strength, first);
  EXPECT_TRUE(heights.Settled());
  EXPECT_TRUE(heights.Doubts().empty());
  EXPECT_EQ(drive.problem.heights.size(), 12u);
}

TEST(CameraHeights, APlaneThatDoesNotFollowIsDroppedAndTheOthersStartAgain) {
  Drive drive({0.0, 0.0, 0.3, 0.005, -0.005});
  CameraHeights heights(drive.options, drive.sigma, 1.0);
  heights.Update(drive.model, drive.problem);
  EXPECT_EQ(drive.NumHeightsOver(2), 3u);
  heights.Update(drive.model, drive.problem);
  EXPECT_EQ(drive.NumHeightsOver(2), 0u);
  EXPECT_FALSE(drive.model.planes[2].in_use);
  EXPECT_DOUBLE_EQ(drive.model.ground_strength, 1.0);
  EXPECT_DOUBLE_EQ(drive.problem.heights.front().sigma_relative, 0.01);
  heights.Update(drive.model, drive.problem);
  EXPECT_TRUE(heights.Settled());
  EXPECT_TRUE(heights.Doubts().empty());
}

TEST(CameraHeights, HeightsThatDoNotFollowAtAllAreDoubted) {
  Drive drive({-0.1, 0.1, -0.05, 0.05, 0.0});
  CameraHeights heights(drive.options, drive.sigma, 1.0);
  heights.Update(drive.model, drive.problem);
  EXPECT_FALSE(heights.contradicted());
  heights.Update(drive.model, drive.problem);
  EXPECT_TRUE(heights.contradicted());
  EXPECT_NE(heights.Doubts().find("7.1 %"), std::string::npos) << heights.Doubts();
}

TEST(CameraHeights, NothingIsTiedToPlanesOutOfUse) {
  PlaneModel model;
  model.planes.resize(3);
  model.planes[1].in_use = false;
  BundleProblem problem;
  problem.relations.resize(3);
  for (int k = 0; k < 3; ++k) {
    problem.relations[k].plane_a = k;
    problem.relations[k].plane_b = (k + 1) % 3;
    problem.heights.push_back({k, k, 0.01});
  }
  DropUnusedStructure(model, problem);
  ASSERT_EQ(problem.relations.size(), 1u);
  EXPECT_EQ(problem.relations[0].plane_a, 2);
  ASSERT_EQ(problem.heights.size(), 2u);
  EXPECT_EQ(problem.heights[0].plane, 0);
  EXPECT_EQ(problem.heights[1].plane, 2);
}

}  // namespace
}  // namespace s3lam
