#include "s3lam/refine/outer_loop.h"
#include "s3lam/refine/constraints.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <stdexcept>

#include "s3lam/base/log.h"
#include "s3lam/base/timer.h"
#include "s3lam/refine/camera_heights.h"
#include "s3lam/refine/flattening.h"

namespace s3lam {
namespace {

/// May the weight of the heights be raised until the map follows, and what of the cameras may then
/// follow too? If the map does not follow, the heights vary in reality, or the ground is not what
/// it was taken for.
struct HeightPull {
  bool raised = false;
  RefinedWithHeights cameras = RefinedWithHeights::kNone;
};

class OuterLoop {
 public:
  /// `planes` and `classes` may be null: without planes.
  OuterLoop(const OuterLoopSettings& settings, const ClassTable* classes, PlaneModel* planes,
            BundleMap& map, const HeightPull& pull = {})
      : settings_(settings),
        classes_(classes),
        planes_(planes),
        map_(map),
        pull_(pull),
        heights_(settings.camera_height, settings.planes.sigma, settings.solver.sigma_px) {}

  std::vector<OuterIteration> Run() {
    if (pull_.cameras != RefinedWithHeights::kNone) FreeCameras();
    for (int i = 0; i < settings_.outer.max_iterations; ++i) {
      const Timer timer;
      OuterIteration iteration;
      iteration.with_planes = planes_ != nullptr;
      if (iteration.with_planes) {
        if (i > 0) {
          UpdatePlanes();
          if (i == 1) RelatePlanes();
          if (pull_.raised) heights_.Update(*planes_, map_.problem);
          if (heights_.contradicted()) break;
        }
        iteration.membership = AssignPoints(settings_.planes.membership, settings_.planes.sigma,
                                            settings_.solver, *planes_, map_.problem);
        DropUnusedStructure(*planes_, map_.problem);
        if (iteration.membership.members == 0) {
          lost_planes_ = true;
          break;
        }
        if (settings_.planes.mode == PlaneMode::kHard) {
          MarkExactPlanes(settings_.exact_planes, settings_.solver.sigma_px, *planes_, exact_,
                          map_.problem);
          iteration.exact_points = exact_.num_points;
        }
      }
      iteration.solve = SolveBundle(settings_.solver, settings_.journal, map_.problem);
      MendPoints(iteration);
      iteration.observations =
          SelectObservations(settings_.outliers, settings_.solver.sigma_px, false, map_);
      KeepGauge();
      iteration.seconds = timer.Seconds();
      iterations_.push_back(iteration);
      Log(i);
      if (i == 0) CheckProgress(iteration.solve);
      if (Settled(iteration, i)) break;
    }
    return iterations_;
  }

  [[nodiscard]] std::string DoubtsAboutHeights() const { return heights_.Doubts(); }
  /// In the end no plane had enough points near it.
  [[nodiscard]] bool lost_planes() const { return lost_planes_; }
  /// That follow the heights.
  [[nodiscard]] const std::vector<IntrinsicsReport>& cameras() const { return cameras_; }

 private:
  /// The input must not pass for a result.
  static void CheckProgress(const BundleSolverReport& solve) {
    if (solve.converged || solve.final_cost < solve.initial_cost) return;
    throw std::runtime_error("the bundle adjustment finds no better map than its input: " +
                             solve.message);
  }

  /// What held the world may have lost its observations.
  void KeepGauge() {
    const std::vector<uint8_t> used = map_.problem.UsedPoses();
    const Gauge& gauge = map_.problem.gauge;
    const auto is_lost = [&](int pose) { return pose >= 0 && used[pose] == 0; };
    if (is_lost(gauge.fixed_pose) || is_lost(gauge.scale_pose)) {
      map_.problem.gauge = ChooseGaugeWithConstraints(map_.problem);
    }
  }

  /// Tracks are merged without planes only: these know their points by index.
  void MendPoints(OuterIteration& iteration) {
    const double sigma_px = settings_.solver.sigma_px;
    iteration.retriangulated =
        RetriangulatePoints(settings_.retriangulation, settings_.outliers, sigma_px, map_);
    if (iteration.with_planes) return;
    iteration.merged = MergePoints(settings_.retriangulation, sigma_px, map_);
  }

  void UpdatePlanes() {
    FreezeUncertainty(map_.problem, settings_.solver.sigma_px, *planes_);
    RefitPlanes(settings_.planes.sigma, settings_.solver.sigma_px, true, *planes_, map_.problem);
  }

  /// Once, after the first solve with planes has sharpened them.
  void RelatePlanes() {
    if (!settings_.relations.enabled || settings_.planes.mode == PlaneMode::kFixed) return;
    const std::vector<RelationTerm> relations =
        ProposeRelations(settings_.relations, settings_.planes.sigma, settings_.solver.sigma_px,
                         *classes_, *planes_, map_.problem);
    map_.problem.relations.insert(map_.problem.relations.end(), relations.begin(), relations.end());
    if (!relations.empty()) spdlog::info("{} relations between planes", relations.size());
  }

  /// What bundle adjustment is too sure of the scale by is what its cameras leave out: a
  /// distortion that is off by a pixel at the border makes the scale drift, and so does a principal
  /// point.
  void FreeCameras() {
    IntrinsicsOptions options = settings_.intrinsics;
    options.distortion = true;
    if (pull_.cameras == RefinedWithHeights::kAll) {
      options.focal_length = options.principal_point = options.tangential = true;
    }
    options.shared = false;  // Those that are to be one are one already.
    cameras_ = FreeIntrinsics(options, {}, map_);
    std::erase_if(cameras_, [](const auto& camera) { return !camera.refined; });
    if (cameras_.empty()) {
      map_.problem.free_camera_params.clear();
      return;
    }
    spdlog::info("{} of {} cameras may follow the heights",
                 pull_.cameras == RefinedWithHeights::kAll ? "all parameters" : "the distortion",
                 cameras_.size());
  }

  [[nodiscard]] bool Settled(const OuterIteration& iteration, int index) const {
    const double allowed = settings_.outer.max_changed;
    const size_t changed = iteration.observations.changed + iteration.merged;
    const bool observations_settled =
        static_cast<double>(changed) <= allowed * static_cast<double>(iteration.observations.total);
    if (!iteration.with_planes) return observations_settled;
    if (!heights_.Settled()) return false;
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
    if (it.exact_points > 0) planes += fmt::format(", {} exactly", it.exact_points);
    if (it.retriangulated > 0) planes += fmt::format(", {} triangulated anew", it.retriangulated);
    if (it.merged > 0) planes += fmt::format(", {} merged", it.merged);
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
  const ClassTable* classes_;
  PlaneModel* planes_;
  BundleMap& map_;
  ExactPlanes exact_;
  HeightPull pull_;
  CameraHeights heights_;
  std::vector<OuterIteration> iterations_;
  bool lost_planes_ = false;
  std::vector<IntrinsicsReport> cameras_;
};

void LogGround(const GroundReport& ground) {
  if (ground.in_use) {
    spdlog::info("camera height: {} cameras over {} ground planes, height {:.4g} map units",
                 ground.num_cameras, ground.num_planes, ground.height);
  } else {
    spdlog::info("camera height not used: {}", ground.reason);
  }
}

/// What is left of the ground that was found.
void CountGround(const BundleProblem& problem, GroundReport& ground) {
  std::set<int> planes;
  for (const HeightTerm& term : problem.heights) planes.insert(term.plane);
  ground.num_planes = planes.size();
  ground.num_cameras = problem.heights.size();
}

/// What an adjustment with planes starts from.
struct PlanarStart {
  PlaneModel planes;
  BundleMap map;
};

struct PlanarResult {
  PlanarReport report;
  std::string doubts_about_heights;
  HeldCameras doubtful_cameras;
  bool lost_planes = false;

  /// Why the heights should not be followed like this; empty if they should.
  [[nodiscard]] std::string Doubts() const {
    return doubtful_cameras.empty() ? doubts_about_heights : doubtful_cameras.begin()->second;
  }
};

PlanarResult AdjustWithPlanes(const OuterLoopSettings& settings, const SemanticMap& semantics,
                              const HeightPull& pull, PlaneModel& planes, BundleMap& map) {
  if (planes.planes.empty()) return {};
  for (size_t k = 0; k < planes.planes.size(); ++k) {
    // The ground under the cameras is what their heights are measured from: never held.
    map.problem.planes[k].is_constant =
        settings.planes.mode == PlaneMode::kFixed && !planes.planes[k].is_ground;
  }
  const std::vector<Camera> cameras = map.problem.cameras;
  InitialisePlanes(settings.planes, settings.solver.sigma_px, planes, map.problem);
  OuterLoop loop(settings, &semantics.class_table, &planes, map, pull);
  PlanarResult result;
  result.report.iterations = loop.Run();
  result.doubts_about_heights = loop.DoubtsAboutHeights();
  result.lost_planes = loop.lost_planes();
  if (!loop.cameras().empty()) {
    result.doubtful_cameras = DoubtfulCameras(settings.intrinsics, cameras, map);
    result.report.cameras = loop.cameras();
    TellParameters(map, result.report.cameras);
    result.report.refined_camera_params = std::exchange(map.problem.free_camera_params, {});
  }
  if (!pull.raised || result.Doubts().empty()) {
    map.points_as_adjusted = map.problem.points;
    FlattenPoints(settings.solver, settings.planes.sigma, planes, settings.journal, map.problem);
  }
  return result;
}

RefinedWithHeights LessThan(RefinedWithHeights cameras) {
  return cameras == RefinedWithHeights::kAll ? RefinedWithHeights::kDistortion
                                             : RefinedWithHeights::kNone;
}

/// With the camera's height as far as it is found, asked for and not contradicted.
PlanarResult AdjustWithGround(const OuterLoopSettings& settings, const SemanticMap& semantics,
                              const PlanarStart& start, PlaneModel& planes, BundleMap& map) {
  const CameraHeightOptions& options = settings.camera_height;
  const double sigma_px = settings.solver.sigma_px;
  GroundReport ground;
  const auto adjust = [&](const HeightPull& pull) {
    PlanarResult result = AdjustWithPlanes(settings, semantics, pull, planes, map);
    result.report.ground = ground;
    return result;
  };
  const auto restart = [&](bool with_ground) {
    planes = start.planes;
    map = start.map;
    if (with_ground) ground = AddGround(options, semantics, sigma_px, planes, map);
  };
  if (options.mode == CameraHeightMode::kOff) return adjust({});
  ground = AddGround(options, semantics, sigma_px, planes, map);
  LogGround(ground);
  if (!ground.in_use) return adjust({});
  const bool may_be_camera = ground.spread_before > options.sigma_relative;
  RefinedWithHeights cameras = may_be_camera ? options.refine_camera : RefinedWithHeights::kNone;
  PlanarResult result = adjust({true, cameras});
  while (!result.report.cameras.empty() && !result.Doubts().empty()) {
    spdlog::info("again with less of the camera refined: {}", result.Doubts());
    cameras = LessThan(cameras);
    restart(true);
    result = adjust({true, cameras});
  }
  if (result.doubts_about_heights.empty()) return result;
  if (options.mode == CameraHeightMode::kOn) {
    spdlog::warn("camera height: {}; it counts for less", result.doubts_about_heights);
    restart(true);
  } else {
    restart(false);
    ground.in_use = false;
    ground.reason = result.doubts_about_heights;
    LogGround(ground);
  }
  return adjust({});
}

/// What the planes did to the map before they lost their points is undone.
void ReturnWithoutPlanes(const PlanarStart& start, PlaneModel& planes, BundleMap& map,
                         GroundReport& ground) {
  spdlog::warn("no plane has enough points near it: the result is without planes");
  planes = start.planes;
  map = start.map;
  for (PlaneState& plane : planes.planes) plane.in_use = false;
  DropUnusedStructure(planes, map.problem);
  if (!ground.in_use) return;
  ground.in_use = false;
  ground.reason = "too few points are near the ground";
}

}  // namespace

void OuterLoopOptions::Visit(OptionVisitor& v) {
  v.Value("max_iterations", max_iterations,
          "most rounds of solving and choosing inliers, without planes and again with them", 1,
          1000);
  v.Value("max_changed", max_changed,
          "rounds end when at most this part of the observations and points changes sides", 0.0,
          1.0);
}

std::vector<OuterIteration> AdjustPlain(OuterLoopSettings& settings, BundleMap& map) {
  // A map handed over as another program left it may fit its keypoints much better afterwards.
  constexpr int kMostRounds = 3;
  constexpr double kSameSigma = 0.1;
  double& sigma_px = settings.solver.sigma_px;
  const auto measure = [&] {
    return settings.keypoint_sigma_px > 0.0 ? settings.keypoint_sigma_px
                                            : MeasureKeypointSigma(map);
  };
  std::vector<OuterIteration> iterations;
  sigma_px = measure();
  for (int round = 0; round < kMostRounds; ++round) {
    spdlog::info("standard deviation of a keypoint: {:.3g} px", sigma_px);
    const auto again = OuterLoop(settings, nullptr, nullptr, map).Run();
    iterations.insert(iterations.end(), again.begin(), again.end());
    const double change_of_cameras = MeasureCameraSigmas(map);
    const double measured = measure();
    const double change = std::max(change_of_cameras, std::abs(measured / sigma_px - 1.0));
    if (change <= kSameSigma) break;
    sigma_px = measured;
  }
  return iterations;
}

PlanarReport AdjustPlanar(const OuterLoopSettings& settings, const SemanticMap& semantics,
                          PlaneModel& planes, BundleMap& map) {
  if (settings.planes.mode == PlaneMode::kOff || semantics.clusters.empty()) return {};
  FreezeUncertainty(map.problem, settings.solver.sigma_px, planes);
  const PlanarStart start{planes, map};
  PlanarResult result = AdjustWithGround(settings, semantics, start, planes, map);
  PlanarReport& report = result.report;
  if (result.lost_planes) {
    ReturnWithoutPlanes(start, planes, map, report.ground);
    return {{}, report.ground, {}, {}};
  }
  if (report.ground.in_use) {
    report.ground.height = map.problem.height;
    report.ground.spread_after = HeightSpread(map.problem);
    CountGround(map.problem, report.ground);
  }
  return std::move(report);
}

}  // namespace s3lam
