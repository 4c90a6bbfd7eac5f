#pragma once

#include "s3lam/base/step_store.h"
#include "s3lam/refine/bundle_solver.h"

namespace s3lam {

/// SolveBundle for a run that can be interrupted: the solution of every solve is kept, and a run
/// that goes on takes it from there instead of solving again. Everything between the solves is
/// done anew, which costs little and leads to the same state.
class SolveJournal {
 public:
  /// `steps` outlives the journal; null: nothing is kept.
  explicit SolveJournal(StepStore* steps) : steps_(steps) {}

  /// As SolveBundle. Throws std::runtime_error as well if what is kept does not belong to a problem
  /// with these values.
  BundleSolverReport Solve(const BundleSolverOptions& options, BundleProblem& problem);

 private:
  StepStore* steps_;
  int num_solves_ = 0;
};

/// By the journal, if there is one (may be null).
BundleSolverReport SolveBundle(const BundleSolverOptions& options, SolveJournal* journal,
                               BundleProblem& problem);

}  // namespace s3lam
