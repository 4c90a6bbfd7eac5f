#include "calibration_steps.h"

#include "s3lam/base/log.h"
#include "s3lam/base/parallel.h"

namespace s3lam::slam {
namespace {

/// Undistorts everything anew.
void ChangeCamera(const Camera& camera, int num_threads, std::vector<FrameFeatures>& frames,
                  Undistorter& undistorter) {
  undistorter = Undistorter(camera);
  ParallelFor(frames.size(), num_threads, [&](size_t i) { frames[i].Undistort(undistorter); });
}

}  // namespace

void AdjustMaps(const Options& options, const Submaps& maps) {
  for (const auto& builder : maps) {
    builder->mapper().AdjustGlobally(builder->map(), options.global_rounds, options.num_threads);
  }
}

FocalReport SearchCamera(const Options& options, const Input& input, const Vocabulary& vocabulary,
                         std::vector<FrameFeatures>& frames, Undistorter& undistorter) {
  FocalReport report;
  report.guess = report.refined = input.focal_prior->focal;
  report.guess_relative_sigma = input.focal_prior->relative_sigma;
  report.noise_sigma = report.guess * report.guess_relative_sigma;
  const TrialMapOptions trials{options.focal_search, options.self_calibration, options.features,
                               options.initializer,  options.tracker,          options.mapper,
                               options.num_threads};
  const auto found = SearchFocal(trials, frames, vocabulary, input.camera, *input.focal_prior);
  if (found) {
    ChangeCamera(found->camera, options.num_threads, frames, undistorter);
  } else {
    spdlog::warn("no stretch of the sequence suggests a focal length to believe");
  }
  return report;
}

void RefineCamera(const Options& options, const FocalPrior& prior,
                  std::vector<FrameFeatures>& frames, Undistorter& undistorter, const Submaps& maps,
                  FocalReport& report) {
  Map& map = maps.front()->map();
  const CalibrationProblem problem = MakeCalibrationProblem(map);
  const auto refined =
      RefineIntrinsics(options.self_calibration, undistorter.camera(), prior, problem);
  if (!refined) {
    spdlog::warn("the focal length cannot be refined");
    return;
  }
  if (!IsBelievable(*refined, prior)) {
    spdlog::warn("the focal length is not refined: {:.1f} +- {:.1f} px cannot be believed",
                 refined->camera.FocalX(), refined->focal_sigma);
    return;
  }
  ApplyRefinement(*refined, map);
  report.refined = refined->camera.FocalX();
  report.noise_sigma = refined->focal_sigma;
  report.parts_sigma = 0.0;
  spdlog::info("focal length refined to {:.2f} +- {:.2f} px", report.refined, report.noise_sigma);
  ChangeCamera(refined->camera, options.num_threads, frames, undistorter);
  AdjustMaps(options, maps);
}

void Recalibrate(const Options& options, std::vector<FrameFeatures>& frames,
                 Undistorter& undistorter, const Submaps& maps, Report& report) {
  if (!options.self_calibration.enabled) return;
  const SelfCalibrationReport calibration = CheckCalibration(
      options.self_calibration, undistorter.camera(), MakeCalibrationProblem(maps.front()->map()));
  spdlog::info("a refined lens distortion would explain {:.1f} % of the reprojection cost: {}",
               100.0 * calibration.cost_decrease,
               calibration.accepted ? "refined" : "camera kept as given");
  report.calibration_was_checked = true;
  report.camera_was_refined = calibration.accepted;
  report.distortion_cost_share = calibration.cost_decrease;
  report.pinhole_cost_share = calibration.pinhole_cost_decrease;
  report.better_pinhole = calibration.better_pinhole;
  if (!calibration.accepted) return;
  ChangeCamera(calibration.camera, options.num_threads, frames, undistorter);
  AdjustMaps(options, maps);
}

void Calibrate(const Options& options, const Input& input, RunState& state) {
  if (!input.focal_prior) {
    return Recalibrate(options, state.frames, state.undistorter, state.maps, state.report);
  }
  RefineCamera(options, *input.focal_prior, state.frames, state.undistorter, state.maps,
               *state.report.focal);
  state.report.focal->parts_sigma =
      FocalSigmaBetweenParts(options.self_calibration, state.undistorter.camera(),
                             *input.focal_prior, MakeCalibrationProblem(state.maps.front()->map()));
}

void AdjustFinally(const Options& options, const Undistorter& undistorter, const Submaps& maps) {
  if (!options.second_pass.patches.enabled) return AdjustMaps(options, maps);
  AdjustAligned(options, undistorter, maps);
}

void AdjustAligned(const Options& options, const Undistorter& undistorter, const Submaps& maps) {
  if (!options.second_pass.patches.enabled) return;
  const AlignmentNoiseOptions& noise = options.second_pass.noise;
  if (!noise.measured) return AdjustMaps(options, maps);
  for (const auto& builder : maps) {
    Map& map = builder->map();
    MeasureAlignedSigmas(noise, undistorter, map);
    spdlog::info("standard deviation of aligned keypoints: {:.3g} to {:.3g} px",
                 map.aligned_sigma(0), map.aligned_sigma(map.num_levels() - 1));
    builder->mapper().AdjustGlobally(map, options.global_rounds, options.num_threads,
                                     noise.max_reprojection_sigma);
  }
}

}  // namespace s3lam::slam
