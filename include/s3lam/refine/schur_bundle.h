#pragma once

#include "s3lam/refine/bundle_solver.h"

namespace s3lam {

/// False for problems that only Ceres solves: with points exactly on planes.
bool CanSolveBySchur(const BundleProblem& problem);

/// The same minimisation as Ceres does in SolveBundle (Levenberg-Marquardt with the same rules for
/// the trust region and for stopping, points eliminated first), written for this one problem: no
/// residual block, no Jacobian row and no parameter block exists as an object of its own, a tenth
/// of the memory and a fraction of the time. Runs on `options.num_threads` threads and gives the
/// same bytes for any number of them. Ceres is what its results are held against in the tests.
///
/// Throws std::runtime_error, leaving the problem as it was, if the options are refused
/// or the solution is not usable.
BundleSolverReport SolveBundleBySchur(const BundleSolverOptions& options, BundleProblem& problem);

}  // namespace s3lam
