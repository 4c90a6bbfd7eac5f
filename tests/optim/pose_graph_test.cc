#include "s3lam/optim/pose_graph.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace s3lam {
namespace {

constexpr int kNodes = 24;

/// Cameras around a circle, looking along it.
std::vector<Similarity3> MakeCircle() {
  std::vector<Similarity3> nodes;
  for (int i = 0; i < kNodes; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / kNodes;
    Similarity3 world_from_cam;
    world_from_cam.rotation = QuaternionFromRotationVector({0.0, 0.0, angle});
    world_from_cam.translation = {5.0 * std::cos(angle), 5.0 * std::sin(angle), 0.1 * i};
    nodes.push_back(world_from_cam.Inverse());
  }
  return nodes;
}

void AddEdge(const std::vector<Similarity3>& truth, int a, int b, PoseGraph& graph) {
  graph.edges.push_back({a, b, truth[a] * truth[b].Inverse(), 2.0, 1.0});
}

TEST(PoseGraph, SpreadsTheDriftOfScaleRotationAndPlaceAroundALoop) {
  const std::vector<Similarity3> truth = MakeCircle();
  PoseGraph graph;
  graph.nodes = {truth[0]};
  // Every step is a little too long and turns a little too far: what the open chain then looks
  // like.
  const Similarity3 drift{
      1.02, QuaternionFromRotationVector({0.004, 0.0, 0.01}), {0.01, 0.02, 0.0}};
  for (int i = 1; i < kNodes; ++i) {
    AddEdge(truth, i, i - 1, graph);
    graph.nodes.push_back(drift * truth[i] * truth[i - 1].Inverse() * graph.nodes.back());
  }
  AddEdge(truth, 0, kNodes - 1, graph);
  const PoseGraphReport report = OptimizePoseGraph(graph);
  ASSERT_TRUE(report.usable);
  EXPECT_GT(report.initial_cost, 0.1);
  EXPECT_LT(report.final_cost, 1e-12);
  for (int i = 0; i < kNodes; ++i) {
    const Similarity3 error = graph.nodes[i] * truth[i].Inverse();
    EXPECT_NEAR(error.scale, 1.0, 1e-5) << i;
    EXPECT_LT(error.translation.norm(), 1e-4) << i;
    EXPECT_LT(RotationAngle(error.rotation, Eigen::Quaterniond::Identity()), 1e-5) << i;
  }
}

TEST(PoseGraph, HoldsTheFixedNodeAndWeighsContradictions) {
  PoseGraph graph;
  graph.nodes.resize(2);
  graph.fixed = 1;
  graph.nodes[1].translation = {1.0, 2.0, 3.0};
  Similarity3 measured;
  measured.translation = {1.0, 0.0, 0.0};
  graph.edges.push_back({0, 1, measured, 1.0, 2.0});
  measured.translation = {0.0, 0.0, 0.0};
  graph.edges.push_back({0, 1, measured, 1.0, 1.0});
  ASSERT_TRUE(OptimizePoseGraph(graph).usable);
  EXPECT_EQ(graph.nodes[1].translation, Eigen::Vector3d(1.0, 2.0, 3.0));
  // Weights 2 and 1 count as 4 and 1.
  const Similarity3 a_from_b = graph.nodes[0] * graph.nodes[1].Inverse();
  EXPECT_NEAR(a_from_b.translation.x(), 0.8, 1e-5);
}

}  // namespace
}  // namespace s3lam
