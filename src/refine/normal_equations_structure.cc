// The terms of NormalEquations that touch no point: relations, heights of cameras, pose priors.

#include <limits>

#include "s3lam/optim/huber.h"
#include "s3lam/refine/manifolds.h"
#include "s3lam/refine/normal_equations.h"

namespace s3lam {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Where a term's blocks are in a state, and how they move.
struct BlockAccess {
  const double* values;
  const ceres::Manifold* manifold;  // Null: one number.
};

BlockAccess Access(const BundleState& state, const StructureBlock& block) {
  static const PoseManifold pose_manifold;
  static const AnchoredPlaneManifold plane_manifold;
  switch (block.kind) {
    case StructureBlock::Kind::kPose:
      return {state.poses[block.index].data(), &pose_manifold};
    case StructureBlock::Kind::kPlane:
      return {state.planes[block.index].data(), &plane_manifold};
    case StructureBlock::Kind::kHeight:
      break;
  }
  return {&state.height, nullptr};
}

using RowMajorMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Evaluates a term; with `jacobians`, those by the tangents of all its blocks.
bool Evaluate(const StructureTerm& term, const BundleState& state, Eigen::VectorXd& residual,
              std::vector<Eigen::MatrixXd>* jacobians) {
  const size_t n = term.blocks.size();
  residual.resize(term.cost->num_residuals());
  std::vector<const double*> values;
  std::vector<RowMajorMatrix> ambient(n);
  std::vector<double*> ambient_data;
  for (size_t b = 0; b < n; ++b) {
    values.push_back(Access(state, term.blocks[b]).values);
    ambient[b].resize(residual.size(), term.cost->parameter_block_sizes()[b]);
    ambient_data.push_back(ambient[b].data());
  }
  if (!term.cost->Evaluate(values.data(), residual.data(),
                           jacobians == nullptr ? nullptr : ambient_data.data())) {
    return false;
  }
  if (jacobians == nullptr) return true;
  jacobians->clear();
  for (size_t b = 0; b < n; ++b) {
    const ceres::Manifold* manifold = Access(state, term.blocks[b]).manifold;
    if (manifold == nullptr) {
      jacobians->push_back(ambient[b]);
      continue;
    }
    RowMajorMatrix plus(manifold->AmbientSize(), manifold->TangentSize());
    manifold->PlusJacobian(values[b], plus.data());
    jacobians->push_back(ambient[b] * plus);
  }
  return true;
}

double ThresholdOf(const StructureTerm& term, const BundleSolverOptions& options) {
  switch (term.loss) {
    case StructureTerm::Loss::kPlane:
      return options.huber_plane;
    case StructureTerm::Loss::kReprojection:
      return options.huber_reprojection;
    case StructureTerm::Loss::kNone:
      break;
  }
  return kInfinity;
}

}  // namespace

double NormalEquations::StructureCost(const BundleState& state) const {
  double sum = 0.0;
  Eigen::VectorXd residual;
  for (const StructureTerm& term : terms_) {
    if (!Evaluate(term, state, residual, nullptr)) return kInfinity;
    const double squared = residual.squaredNorm();
    sum += Huber(squared, ThresholdOf(term, options_));
  }
  return 0.5 * sum;
}

void NormalEquations::LinearizeStructure(const BundleState& state) {
  linear_terms_.clear();
  for (const StructureTerm& term : terms_) {
    LinearTerm linear;
    std::vector<Eigen::MatrixXd> jacobians;
    if (!Evaluate(term, state, linear.residual, &jacobians)) continue;  // The cost is infinite.
    const double weight = HuberWeight(linear.residual.squaredNorm(), ThresholdOf(term, options_));
    linear.residual *= weight;
    for (size_t b = 0; b < term.blocks.size(); ++b) {
      const int i = layout_.VariableOf(term.blocks[b]);
      if (i < 0) continue;
      Eigen::MatrixXd jacobian = weight * jacobians[b];
      if (i == layout_.held_pose) {
        jacobian -= (jacobian * held_direction_).eval() * held_direction_.transpose();
      }
      const int offset = layout_.offset[i];
      const int size = layout_.size[i];
      gradient_c_.segment(offset, size) += jacobian.transpose() * linear.residual;
      diagonal_.segment(offset, size) += jacobian.colwise().squaredNorm().transpose();
      linear.variables.push_back(i);
      linear.jacobians.push_back(std::move(jacobian));
    }
    linear_terms_.push_back(std::move(linear));
  }
}

}  // namespace s3lam
