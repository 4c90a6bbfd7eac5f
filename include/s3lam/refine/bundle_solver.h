#pragma once

#include <Eigen/SparseCore>
#include <functional>
#include <string>

#include "s3lam/base/options.h"
#include "s3lam/refine/bundle_problem.h"

namespace s3lam {

enum class LinearSolver { kAuto, kDenseSchur, kSparseSchur, kIterativeSchur };

/// Whose code minimises: our own, or Ceres.
enum class SolverBackend { kAuto, kSchur, kCeres };

struct BundleSolverOptions {
  double sigma_px = 1.0;  // Of a keypoint of relative sigma one; not a configuration value: see
                          // OuterLoopSettings.
  double huber_reprojection = 2.4477;  // sqrt(5.991): 95 % of chi-squared with 2 dof
  double huber_plane = 1.9600;         // sqrt(3.841): 95 % with 1 dof
  int max_iterations = 50;
  double function_tolerance = 1e-6;
  LinearSolver linear_solver = LinearSolver::kAuto;
  SolverBackend backend = SolverBackend::kAuto;
  int num_threads = 0;  // 0: all of the machine's. Not a part of the configuration.

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
///   sum rho(|| (proj(T_i X_j) - x_ij) / (sigma_px s_ij) ||) + sum rho((n_k . X_j + d_k) / sigma_j)
///   + relations between planes + constant camera height
/// Points are eliminated first, planes and height stay with the poses. On return the problem holds
/// the solution, the same bytes for any number of threads. The project's own solver
/// (SolveBundleBySchur) does it; Ceres, when asked for, is the reference and runs on one thread:
/// with more, it adds the blocks of the Schur complement and the gradient in the order in which its
/// threads arrive, and the last digits differ from run to run. Throws std::runtime_error, leaving
/// the problem as it was, if the options are refused or the solution is not usable.
BundleSolverReport SolveBundle(const BundleSolverOptions& options, BundleProblem& problem);

/// Derivatives of all residuals of SolveBundle, weighted by the robust losses, at the present
/// values. Columns: poses, planes, height and cameras, as far as they are estimated, then points.
struct BundleLinearization {
  Eigen::SparseMatrix<double> jacobian;
  int num_other_columns = 0;                    // Before the points' columns.
  std::vector<int> pose_columns;                // Per pose: its first column; -1 if it is constant.
  std::vector<Eigen::MatrixXd> full_from_pose;  // Per pose: (w, v) by its columns' tangent.
  std::vector<int> plane_columns;  // Per plane: its first column (of three); -1 if constant.
  std::vector<int> point_columns;  // First column of every estimated point, ascending.
};
BundleLinearization LinearizeBundle(const BundleSolverOptions& options,
                                    const BundleProblem& problem);

/// The cost SolveBundle minimises at the present values (infinity with a point behind a camera).
double BundleCost(const BundleSolverOptions& options, const BundleProblem& problem);

}  // namespace s3lam
