#pragma once

#include "s3lam/refine/bundle_solver.h"
#include "s3lam/refine/plane_model.h"
#include "s3lam/refine/solve_journal.h"

namespace s3lam {

/// Moves the points on planes to where they lie if their surfaces are flat; cameras and planes
/// stay. What points scatter by beyond their keypoints' sigma is mostly what the keypoints of a
/// track err by in common. While poses are refined it must count as scatter, or the poses take it
/// up. Once they stand it is laid to the keypoints: these count as kappa times less certain against
/// a plane that is flat to one of them. Does nothing where the sigma of planes is given
/// (kinds other than pixel). `journal` may be null.
void FlattenPoints(const BundleSolverOptions& solver, const PlaneSigmaOptions& sigma,
                   const PlaneModel& planes, SolveJournal* journal, BundleProblem& problem);

}  // namespace s3lam
