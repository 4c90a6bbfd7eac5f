#include "s3lam/optim/pose_graph.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <array>
#include <cmath>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

constexpr int kMaxIterations = 50;

/// A node as Ceres moves it: rotation vector, translation, log scale.
using Block = std::array<double, 7>;

Block ToBlock(const Similarity3& node) {
  Block block{};
  const std::array<double, 4> q{node.rotation.w(), node.rotation.x(), node.rotation.y(),
                                node.rotation.z()};
  ceres::QuaternionToAngleAxis(q.data(), block.data());
  for (int i = 0; i < 3; ++i) block[static_cast<size_t>(3 + i)] = node.translation[i];
  block[6] = std::log(node.scale);
  return block;
}

Similarity3 FromBlock(const Block& block) {
  std::array<double, 4> q{};
  ceres::AngleAxisToQuaternion(block.data(), q.data());
  Similarity3 node;
  node.rotation = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized();
  node.translation = {block[3], block[4], block[5]};
  node.scale = std::exp(block[6]);
  return node;
}

struct EdgeError {
  Similarity3 b_from_a;  // As measured.
  double length_in_b;
  double weight;

  /// e of E = b_from_a * node_a * node_b^-1.
  template <typename T>
  bool operator()(const T* a, const T* b, T* residual) const {
    using std::exp;
    std::array<T, 4> qa;
    std::array<T, 4> qb;
    ceres::AngleAxisToQuaternion(a, qa.data());
    ceres::AngleAxisToQuaternion(b, qb.data());
    const std::array<T, 4> qb_inverse{qb[0], -qb[1], -qb[2], -qb[3]};
    std::array<T, 4> turn;  // Of node_a * node_b^-1.
    ceres::QuaternionProduct(qa.data(), qb_inverse.data(), turn.data());
    const T scale = exp(a[6] - b[6]);
    std::array<T, 3> turned;
    ceres::UnitQuaternionRotatePoint(turn.data(), b + 3, turned.data());
    std::array<T, 3> translation;
    for (size_t i = 0; i < 3; ++i) translation[i] = a[3 + i] - scale * turned[i];
    const std::array<T, 4> measured{T(b_from_a.rotation.w()), T(b_from_a.rotation.x()),
                                    T(b_from_a.rotation.y()), T(b_from_a.rotation.z())};
    std::array<T, 4> error;
    ceres::QuaternionProduct(measured.data(), turn.data(), error.data());
    ceres::QuaternionToAngleAxis(error.data(), residual);
    ceres::UnitQuaternionRotatePoint(measured.data(), translation.data(), residual + 3);
    for (int i = 0; i < 3; ++i) {
      residual[3 + i] =
          (T(b_from_a.scale) * residual[3 + i] + T(b_from_a.translation[i])) / T(length_in_b);
    }
    residual[6] = T(std::log(b_from_a.scale)) + a[6] - b[6];
    for (int i = 0; i < 7; ++i) residual[i] *= T(weight);
    return true;
  }
};

}  // namespace

PoseGraphReport OptimizePoseGraph(PoseGraph& graph) {
  PoseGraphReport report;
  S3LAM_CHECK(graph.fixed >= 0 && graph.fixed < static_cast<int>(graph.nodes.size()));
  std::vector<Block> blocks;
  for (const Similarity3& node : graph.nodes) blocks.push_back(ToBlock(node));
  ceres::Problem problem;
  for (Block& block : blocks) problem.AddParameterBlock(block.data(), 7);
  problem.SetParameterBlockConstant(blocks[graph.fixed].data());
  for (const PoseGraphEdge& edge : graph.edges) {
    const Similarity3 b_from_a = edge.a_from_b.Inverse();
    auto* error = new EdgeError{b_from_a, b_from_a.scale * edge.length, edge.weight};
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<EdgeError, 7, 7, 7>(error), nullptr,
                             blocks[edge.a].data(), blocks[edge.b].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = kMaxIterations;
  options.num_threads = 1;  // The graph is small, and sums are to be made in one order.
  options.logging_type = ceres::SILENT;
  std::string invalid;
  S3LAM_CHECK(options.IsValid(&invalid));
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  report.initial_cost = summary.initial_cost;
  report.final_cost = summary.final_cost;
  report.usable = summary.IsSolutionUsable();
  if (!report.usable) return report;
  for (size_t i = 0; i < blocks.size(); ++i) graph.nodes[i] = FromBlock(blocks[i]);
  return report;
}

}  // namespace s3lam
