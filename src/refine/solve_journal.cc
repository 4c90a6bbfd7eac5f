#include "s3lam/refine/solve_journal.h"

#include <fmt/format.h>

#include <stdexcept>

#include "s3lam/base/archive.h"
#include "s3lam/base/sha256.h"

namespace s3lam {
namespace {

/// All that a solve may change.
template <typename Archive>
void TransferVariables(Archive& archive, BundleProblem& problem) {
  for (Camera& camera : problem.cameras) archive(camera.params);
  archive(problem.poses, problem.points, problem.height);
  for (AnchoredPlane& plane : problem.planes) archive(plane.parameters);
}

/// Of the values that a solve starts from and of what is observed.
std::string Fingerprint(BundleProblem& problem) {
  ArchiveWriter archive;
  TransferVariables(archive, problem);
  for (const BundleObservation& o : problem.observations) archive(o.pose, o.point, o.pixel, o.sigma);
  for (const PointOnPlane& p : problem.points_on_planes) archive(p.point, p.plane, p.sigma);
  Sha256 hash;
  hash.Update(archive.bytes());
  return hash.Finish();
}

template <typename Archive>
void TransferReport(Archive& archive, BundleSolverReport& report) {
  archive(report.initial_cost, report.final_cost, report.num_iterations, report.converged,
          report.linear_solver, report.message);
}

}  // namespace

BundleSolverReport SolveJournal::Solve(const BundleSolverOptions& options, BundleProblem& problem) {
  if (steps_ == nullptr) return SolveBundle(options, problem);
  const std::string step = fmt::format("solve_{:04}", num_solves_++);
  const std::string fingerprint = Fingerprint(problem);
  BundleSolverReport report;
  if (const auto kept = steps_->Recall(step)) {
    ArchiveReader archive(*kept);
    std::string kept_fingerprint;
    archive(kept_fingerprint);
    if (kept_fingerprint != fingerprint) {
      throw std::runtime_error("the checkpoint's step " + step +
                               " is of another run: begin anew without --resume");
    }
    TransferReport(archive, report);
    TransferVariables(archive, problem);
    return report;
  }
  report = SolveBundle(options, problem);
  ArchiveWriter archive;
  archive(fingerprint);
  TransferReport(archive, report);
  TransferVariables(archive, problem);
  steps_->Keep(step, archive.bytes());
  return report;
}

BundleSolverReport SolveBundle(const BundleSolverOptions& options, SolveJournal* journal,
                               BundleProblem& problem) {
  return journal != nullptr ? journal->Solve(options, problem) : SolveBundle(options, problem);
}

}  // namespace s3lam
