#include "s3lam/refine/outer_loop.h"

#include <algorithm>
#include <array>

#include "s3lam/base/log.h"
#include "s3lam/base/timer.h"

namespace s3lam {
namespace {

class OuterLoop {
 public:
  /// `planes` may be null: without planes.
  OuterLoop(const OuterLoopSettings& settings, PlaneModel* planes, BundleMap& map)
      : settings_(settings), planes_(planes), map_(map) {}

  std::vector<OuterIteration> Run() {
    for (int i = 0; i < settings_.outer.max_iterations; ++i) {
      const Timer timer;
      OuterIteration iteration;
      iteration.with_planes = planes_ != nullptr;
      if (iteration.with_planes) {
        if (i > 0) UpdatePlanes();
        iteration.membership = AssignPoints(settings_.planes.membership, settings_.planes.sigma,
                                            settings_.solver.sigma_px, *planes_, map_.problem);
        if (iteration.membership.members == 0) {
          spdlog::warn("no plane has enough points near it: the result is without planes");
          break;
        }
      }
      iteration.solve = SolveBundle(settings_.solver, map_.problem);
      iteration.observations =
          SelectObservations(settings_.outliers, settings_.solver.sigma_px, false, map_);
      iteration.seconds = timer.Seconds();
      iterations_.push_back(iteration);
      Log(i);
      if (Settled(iteration, i)) break;
    }
    return iterations_;
  }

 private:
  void UpdatePlanes() {
    FreezeUncertainty(map_.problem, settings_.solver.sigma_px, *planes_);
    if (settings_.planes.mode == PlaneMode::kFixed) {
      RefitPlanes(settings_.planes.sigma, settings_.solver.sigma_px, *planes_, map_.problem);
    }
  }

  [[nodiscard]] bool Settled(const OuterIteration& iteration, int index) const {
    const double allowed = settings_.outer.max_changed;
    const bool observations_settled = static_cast<double>(iteration.observations.changed) <=
                                      allowed * static_cast<double>(iteration.observations.total);
    if (!iteration.with_planes) return observations_settled;
    return index > 0 && observations_settled &&
           static_cast<double>(iteration.membership.changed) <=
               allowed * static_cast<double>(iteration.membership.members);
  }

  void Log(int index) const {
    const OuterIteration& it = iterations_.back();
    std::string planes;
    if (it.with_planes) {
      planes = fmt::format(", {} points on planes ({} off), {} changed", it.membership.members,
                           it.membership.outliers, it.membership.changed);
    }
    const int left = settings_.outer.max_iterations - index - 1;
    spdlog::info(
        "{} iteration {}: cost {:.6g} -> {:.6g} in {} steps ({}), {} of {} observations{}; {:.1f} "
        "s, at most {:.0f} s left",
        it.with_planes ? "planar" : "plain", index + 1, it.solve.initial_cost, it.solve.final_cost,
        it.solve.num_iterations, it.solve.linear_solver, it.observations.used,
        it.observations.total, planes, it.seconds, left * it.seconds);
    if (!it.solve.converged) {
      spdlog::warn("the solve stopped before it converged: {}", it.solve.message);
    }
  }

  const OuterLoopSettings& settings_;
  PlaneModel* planes_;
  BundleMap& map_;
  std::vector<OuterIteration> iterations_;
};

}  // namespace

void OuterLoopOptions::Visit(OptionVisitor& v) {
  v.Value("max_iterations", max_iterations,
          "most rounds of solving and choosing inliers, without planes and again with them", 1,
          1000);
  v.Value("max_changed", max_changed,
          "rounds end when at most this part of the observations and points changes sides", 0.0,
          1.0);
}

std::vector<OuterIteration> AdjustPlain(const OuterLoopSettings& settings, BundleMap& map) {
  return OuterLoop(settings, nullptr, map).Run();
}

std::vector<OuterIteration> AdjustPlanar(const OuterLoopSettings& settings, PlaneModel& planes,
                                         BundleMap& map) {
  if (settings.planes.mode == PlaneMode::kOff || planes.planes.empty()) return {};
  map.problem.planes_are_constant = settings.planes.mode == PlaneMode::kFixed;
  FreezeUncertainty(map.problem, settings.solver.sigma_px, planes);
  InitialisePlanes(settings.planes, settings.solver.sigma_px, planes, map.problem);
  return OuterLoop(settings, &planes, map).Run();
}

}  // namespace s3lam
