#pragma once

#include <functional>
#include <string>

#include "s3lam/base/options.h"
#include "s3lam/refine/bundle_problem.h"

namespace s3lam {

enum class LinearSolver { kAuto, kDenseSchur, kSparseSchur, kIterativeSchur };

struct BundleSolverOptions {
  double sigma_px = 1.0;
  double huber_reprojection = 2.4477;  // sqrt(5.991): 95 % of chi-squared with 2 dof
  double huber_plane = 1.9600;         // sqrt(3.841): 95 % with 1 dof
  int max_iterations = 50;
  double function_tolerance = 1e-6;
  LinearSolver linear_solver = LinearSolver::kAuto;

  void Visit(OptionVisitor& v);
};

struct BundleSolverReport {
  double initial_cost = 0.0;  // 1/2 sum rho
  double final_cost = 0.0;
  int num_iterations = 0;
  bool converged = false;
  std::string linear_solver;  // The one used.
  std::string message;        // Why it stopped.
};

/// Minimises
///   sum rho(|| (proj(T_i X_j) - x_ij) / sigma_px ||) + sum rho((n_k . X_j + d_k) / sigma_j)
///   + relations between planes + constant camera height
/// with Ceres: points are eliminated first, planes and height stay with the poses. On return the
/// problem holds the solution. One thread: with more, Ceres adds the blocks of the Schur complement
/// and the gradient in the order in which its threads arrive, and the last digits differ from run
/// to run. Throws std::runtime_error, leaving the problem as it was, if the options are refused or
/// the solution is not usable.
BundleSolverReport SolveBundle(const BundleSolverOptions& options, BundleProblem& problem);

/// The cost SolveBundle minimises at the present values (infinity with a point behind a camera).
double BundleCost(const BundleSolverOptions& options, const BundleProblem& problem);

}  // namespace s3lam
