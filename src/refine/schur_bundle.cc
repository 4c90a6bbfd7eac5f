#include "s3lam/refine/schur_bundle.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "s3lam/optim/block_cholesky.h"
#include "s3lam/refine/normal_equations.h"

namespace s3lam {
namespace {

// As Ceres has them. The gauge is held, and a map's weak modes (bend, drift of scale) need long
// steps: little damping at the start.
constexpr double kInitialRadius = 1e6;
constexpr double kMaxRadius = 1e16;
constexpr double kMinRadius = 1e-32;
constexpr double kMinRelativeDecrease = 1e-3;
constexpr double kParameterTolerance = 1e-10;
constexpr int kMaxRefusedSteps = 20;

// Limits between the linear solvers, measured with benchmarks/runtime/bundle_scaling.py (--solvers
// dense sparse iterative --arms plain --iterations 6). CPU seconds per iteration on drives of 50,
// 100 and 200 keyframes: dense 0.010, 0.022, 0.065; sparse 0.010, 0.019, 0.040; iterative 0.10,
// 0.63, 2.3, with cost and number of conjugate gradient steps growing with the length of the drive.
// So a system is factored whenever its factor fits into 2 GB; the limit to the arithmetic is a
// guess at what nobody waits for.
constexpr int kMaxDenseRows = 300;
constexpr size_t kMaxFactorEntries = 250'000'000;
constexpr double kMaxFactorFlops = 1e13;
constexpr size_t kMaxMatrixValues = 2'000'000'000;  // Of a solver that was asked for.
constexpr int kMaxConjugateGradients = 500;
constexpr double kConjugateGradientTolerance = 1e-3;

/// Solves the reduced system: by factorisation or by conjugate gradients.
class ReducedSystem {
 public:
  ReducedSystem(const BundleSolverOptions& options, const BundleProblem& problem,
                const std::vector<StructureTerm>& terms, const SchurLayout& layout) {
    if (options.linear_solver == LinearSolver::kIterativeSchur) return;
    const bool is_auto = options.linear_solver == LinearSolver::kAuto;
    // A factor has at least the entries of its matrix.
    const auto coupled =
        FindCoupledVariables(problem, terms, layout, is_auto ? kMaxFactorEntries : kMaxMatrixValues,
                             options.num_threads);
    if (coupled.size() < layout.size.size()) return;
    matrix_ = BlockMatrix(layout.size, coupled);
    const bool small = layout.num_rows() <= kMaxDenseRows;
    is_dense_ = options.linear_solver == LinearSolver::kDenseSchur || (is_auto && small);
    factor_ = is_dense_ ? MakeDenseCholesky(matrix_) : MakeSparseCholesky(matrix_);
    const bool too_large = factor_->num_entries() > static_cast<double>(kMaxFactorEntries) ||
                           factor_->num_flops() > kMaxFactorFlops;
    if (is_auto && too_large) {
      factor_.reset();
      matrix_ = BlockMatrix();
      return;
    }
    matrix_.Allocate();
  }

  [[nodiscard]] std::string Name() const {
    if (factor_ == nullptr) return "iterative Schur";
    if (is_dense_) return fmt::format("dense Schur, {} rows", matrix_.num_rows());
    return fmt::format("sparse Schur, {} rows, {:.2g} flops", matrix_.num_rows(),
                       factor_->num_flops());
  }

  /// False if there is no solution. `slack` is x . (right - matrix x).
  bool Solve(const NormalEquations& equations, Eigen::VectorXd& x, double& slack) {
    const Eigen::VectorXd right = equations.ReducedRightSide();
    slack = 0.0;
    if (right.size() == 0) {
      x = right;
      return true;
    }
    if (factor_ == nullptr) return SolveByIteration(equations, right, x, slack);
    equations.FillReduced(matrix_);
    return factor_->Solve(matrix_, right, x);
  }

 private:
  /// Conjugate gradients, preconditioned with the diagonal blocks.
  static bool SolveByIteration(const NormalEquations& equations, const Eigen::VectorXd& right,
                               Eigen::VectorXd& x, double& slack) {
    const auto inverse_blocks = equations.InverseDiagonalBlocks();
    const auto precondition = [&](const Eigen::VectorXd& r) {
      Eigen::VectorXd z(r.size());
      Eigen::Index offset = 0;
      for (const Eigen::MatrixXd& block : inverse_blocks) {
        z.segment(offset, block.rows()) = block * r.segment(offset, block.rows());
        offset += block.rows();
      }
      return z;
    };
    x = Eigen::VectorXd::Zero(right.size());
    Eigen::VectorXd residual = right;
    Eigen::VectorXd z = precondition(residual);
    Eigen::VectorXd direction = z;
    double rho = residual.dot(z);
    const double target = kConjugateGradientTolerance * kConjugateGradientTolerance * rho;
    for (int i = 0; i < kMaxConjugateGradients && rho > target; ++i) {
      const Eigen::VectorXd product = equations.MultiplyReduced(direction);
      const double curvature = direction.dot(product);
      if (!(curvature > 0.0)) break;
      const double alpha = rho / curvature;
      x += alpha * direction;
      residual -= alpha * product;
      z = precondition(residual);
      const double previous = rho;
      rho = residual.dot(z);
      direction = z + (rho / previous) * direction;
    }
    slack = x.dot(residual);
    return x.allFinite();
  }

  BlockMatrix matrix_;
  std::unique_ptr<BlockCholesky> factor_;
  bool is_dense_ = false;
};

BundleState StateOf(const BundleProblem& problem) {
  BundleState state{problem.poses, problem.points, {}, problem.height, {}};
  for (const AnchoredPlane& plane : problem.planes) state.planes.push_back(plane.parameters);
  for (const Camera& camera : problem.cameras) state.camera_params.push_back(camera.params);
  return state;
}

class SchurBundle {
 public:
  SchurBundle(const BundleSolverOptions& options, BundleProblem& problem)
      : options_(options),
        problem_(problem),
        terms_(MakeStructureTerms(problem, problem.UsedPoses())),
        layout_(MakeSchurLayout(problem, terms_)),
        equations_(options, problem, terms_, layout_),
        reduced_(options, problem, terms_, layout_),
        state_(StateOf(problem)) {}

  BundleSolverReport Solve() {
    cost_ = equations_.Linearize(state_);
    if (!std::isfinite(cost_)) {
      throw std::runtime_error("the bundle adjustment failed: the cost is not finite at its start");
    }
    report_.initial_cost = cost_;
    report_.linear_solver = reduced_.Name();
    report_.message = "the most iterations were made";
    while (report_.num_iterations < options_.max_iterations && Iterate()) {
    }
    report_.final_cost = cost_;
    StoreSolution();
    return report_;
  }

 private:
  /// One step, taken or refused; false when done.
  bool Iterate() {
    if (needs_linearization_) equations_.Linearize(state_);
    needs_linearization_ = false;
    ++report_.num_iterations;
    Eigen::VectorXd step;
    double slack = 0.0;
    if (!equations_.Damp(radius_) || !reduced_.Solve(equations_, step, slack)) return Refuse();
    const NormalEquations::Step applied = equations_.Apply(step, slack, state_, trial_);
    if (applied.squared_norm == 0.0) return Converged("nothing moves");
    if (!(applied.model_decrease > 0.0)) return Refuse();
    if (std::sqrt(applied.squared_norm) <=
        kParameterTolerance * (std::sqrt(applied.squared_state_norm) + kParameterTolerance)) {
      return Converged("the step is below the tolerance");
    }
    num_refused_ = 0;
    const double cost = applied.cost;
    const double decrease = cost_ - cost;
    const double quality = decrease / applied.model_decrease;
    const bool is_small = std::abs(decrease) <= options_.function_tolerance * cost_;
    if (quality > kMinRelativeDecrease) {
      std::swap(state_, trial_);
      cost_ = cost;
      needs_linearization_ = true;
      radius_ = std::min(kMaxRadius,
                         radius_ / std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * quality - 1.0, 3)));
      shrink_ = 2.0;
    } else {
      Shrink();
    }
    if (is_small) return Converged("the cost's change is below the tolerance");
    if (radius_ < kMinRadius) return Converged("the trust region vanished");
    return true;
  }

  bool Converged(const char* message) {
    report_.converged = true;
    report_.message = message;
    return false;
  }

  void Shrink() {
    radius_ /= shrink_;
    shrink_ *= 2.0;
  }

  bool Refuse() {
    if (++num_refused_ > kMaxRefusedSteps) {
      throw std::runtime_error(
          "the bundle adjustment failed: the normal equations have no solution");
    }
    Shrink();
    return true;
  }

  void StoreSolution() {
    problem_.poses = std::move(state_.poses);
    problem_.points = std::move(state_.points);
    for (size_t k = 0; k < problem_.planes.size(); ++k) {
      problem_.planes[k].parameters = state_.planes[k];
    }
    problem_.height = state_.height;
    for (size_t c = 0; c < problem_.cameras.size(); ++c) {
      problem_.cameras[c].params = state_.camera_params[c];
    }
  }

  const BundleSolverOptions& options_;
  BundleProblem& problem_;
  std::vector<StructureTerm> terms_;
  SchurLayout layout_;
  NormalEquations equations_;
  ReducedSystem reduced_;
  BundleState state_;
  BundleState trial_;
  BundleSolverReport report_;
  double cost_ = 0.0;
  double radius_ = kInitialRadius;
  double shrink_ = 2.0;
  int num_refused_ = 0;
  bool needs_linearization_ = false;
};

}  // namespace

bool CanSolveBySchur(const BundleProblem& problem) {
  return std::none_of(problem.points_on_planes.begin(), problem.points_on_planes.end(),
                      [](const PointOnPlane& term) { return term.is_exact; });
}

BundleSolverReport SolveBundleBySchur(const BundleSolverOptions& options, BundleProblem& problem) {
  if (!CanSolveBySchur(problem)) {
    throw std::runtime_error(
        "the Schur solver does not take points exactly on planes: leave solver.backend at auto");
  }
  if (options.max_iterations < 0 || !(options.function_tolerance >= 0.0)) {
    throw std::runtime_error(fmt::format(
        "the bundle adjustment's options are refused: max_iterations {}, function_tolerance {}",
        options.max_iterations, options.function_tolerance));
  }
  return SchurBundle(options, problem).Solve();
}

}  // namespace s3lam
