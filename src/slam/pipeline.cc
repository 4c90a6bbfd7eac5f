#include "s3lam/slam/pipeline.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <nlohmann/json.hpp>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/progress.h"
#include "s3lam/slam/export.h"
#include "s3lam/slam/map_builder.h"

namespace s3lam::slam {
namespace {

std::vector<FrameFeatures> ExtractAll(const Options& options, const Input& input,
                                      const Undistorter& undistorter) {
  std::vector<FrameFeatures> frames(input.names.size());
  Progress progress("features", static_cast<int64_t>(frames.size()));
  std::mutex mutex;
  int64_t done = 0;
  ParallelFor(frames.size(), input.concurrent_reads ? options.num_threads : 1, [&](size_t i) {
    const cv::Mat gray = input.read_gray(i);
    if (gray.cols != input.camera.width || gray.rows != input.camera.height) {
      ThrowInputError("{}: image is {} x {}, but the camera has {} x {}", input.names[i], gray.cols,
                      gray.rows, input.camera.width, input.camera.height);
    }
    const cv::Mat mask = input.read_mask ? input.read_mask(i) : cv::Mat();
    frames[i] = ExtractFeatures(options.features, undistorter, gray, mask);
    const std::lock_guard lock(mutex);
    progress.Update(++done);
  });
  return frames;
}

InitialPair Initialize(const Options& options, const std::vector<FrameFeatures>& frames,
                       const Undistorter& undistorter) {
  const auto pair = FindInitialPair(options.initializer, frames, undistorter, options.num_threads);
  if (pair) {
    spdlog::info("map starts from frames {} and {}: {} points, parallax {:.1f} deg", pair->frame_a,
                 pair->frame_b, pair->points.size(), pair->parallax_deg);
    return *pair;
  }
  throw InputError(
      "no pair of frames gives a map to start from: too few matches or no parallax (is the camera "
      "moving, are the calibration and the order of the images right?)");
}

/// The second pass: everything matched again, then every observation aligned, each followed by a
/// bundle adjustment of the whole map.
void ImproveMap(const Options& options, const Input& input, const Undistorter& undistorter,
                MapBuilder& builder, StepTimes& seconds) {
  Map& map = builder.map();
  for (int round = 0; round < options.second_pass.rounds; ++round) {
    {
      const ScopedStep step(seconds, "matching again");
      MatchAgain(options.second_pass, builder.mapper(), map);
    }
    const ScopedStep step(seconds, "global bundle adjustment");
    builder.mapper().AdjustGlobally(map, options.global_rounds, options.num_threads);
  }
  if (!options.second_pass.patches.enabled) return;
  const auto adjust = [&] {
    const ScopedStep step(seconds, "global bundle adjustment");
    builder.mapper().AdjustGlobally(map, options.global_rounds, options.num_threads);
  };
  std::optional<PatchPass> pass;
  {
    const ScopedStep step(seconds, "aligning patches");
    pass.emplace(options.second_pass, options.features, undistorter, input.read_gray,
                 input.concurrent_reads ? options.num_threads : 1, map);
    const PatchRefinement refinement = pass->RefineObservations(map);
    spdlog::info("{} of {} observations aligned", refinement.num_refined, refinement.num_tried);
  }
  adjust();
  if (!options.second_pass.extend_tracks) return;
  {
    const ScopedStep step(seconds, "extending tracks");
    spdlog::info("{} observations found by patches", pass->ExtendTracks(map));
  }
  adjust();
}

/// Checks the lens distortion against the map; where it is refined, everything is undistorted and
/// adjusted again.
SelfCalibrationReport Recalibrate(const Options& options, std::vector<FrameFeatures>& frames,
                                  Undistorter& undistorter, MapBuilder& builder) {
  SelfCalibrationReport report;
  report.camera = undistorter.camera();
  if (!options.self_calibration.enabled) return report;
  report = RefineDistortion(options.self_calibration, undistorter.camera(),
                            MakeCalibrationProblem(builder.map()));
  spdlog::info("a refined lens distortion would explain {:.1f} % of the reprojection cost: {}",
               100.0 * report.cost_decrease, report.accepted ? "refined" : "camera kept as given");
  if (!report.accepted) return report;
  undistorter = Undistorter(report.camera);
  ParallelFor(frames.size(), options.num_threads,
              [&](size_t i) { frames[i].Undistort(undistorter); });
  builder.mapper().AdjustGlobally(builder.map(), options.global_rounds, options.num_threads);
  return report;
}

/// Poses of all frames in the final map: keyframes as they are, others refined against it.
std::vector<FrameTrack> LocalizeFrames(const Options& options, const MapBuilder& builder,
                                       const Map& map) {
  const std::vector<FrameTrack>& tracks = builder.tracks();
  std::vector<int> keyframe_of_frame(tracks.size(), kNoIndex);
  for (int k = 0; k < map.num_keyframes(); ++k) {
    if (map.keyframe(k).alive) keyframe_of_frame[map.keyframe(k).frame] = k;
  }
  const FrameLocalizer localizer(builder.tracker(), map, tracks, keyframe_of_frame);
  std::vector<FrameTrack> localized(tracks.size());
  ParallelFor(tracks.size(), options.num_threads,
              [&](size_t i) { localized[i] = localizer.Localize(static_cast<int>(i)); });
  for (FrameTrack& track : localized) {
    if (static_cast<int>(track.matches.size()) < options.min_localization_inliers) track = {};
  }
  return localized;
}

}  // namespace

void Options::Visit(OptionVisitor& v) {
  v.Group("features", features, "keypoints");
  v.Group("initializer", initializer, "the pair of frames that the map starts from");
  v.Group("tracker", tracker, "localising frames in the map");
  v.Group("mapper", mapper, "growing and pruning the map");
  v.Group("second_pass", second_pass, "what knowing the whole map adds");
  v.Group("self_calibration", self_calibration, "refinement of the lens distortion");
  v.Value("min_localization_inliers", min_localization_inliers,
          "points that a frame must see in the final map to be localised", 6, 10000);
  v.Value("global_rounds", global_rounds,
          "bundle adjustments of the whole map, outliers removed in between, at the most", 1, 100);
}

Result Run(const Options& options, const Input& input) {
  S3LAM_CHECK(input.times_s.size() == input.names.size());
  if (input.names.size() < 4)
    ThrowInputError("a sequence of {} images is too short", input.names.size());
  Result result;
  StepTimes& seconds = result.report.seconds;
  Undistorter undistorter(input.camera);

  std::vector<FrameFeatures> frames;
  {
    const ScopedStep step(seconds, "features");
    frames = ExtractAll(options, input, undistorter);
  }
  InitialPair pair;
  {
    const ScopedStep step(seconds, "initialisation");
    pair = Initialize(options, frames, undistorter);
  }
  Progress progress("tracking", static_cast<int64_t>(frames.size()));
  MapBuilder builder(options.tracker, options.mapper, options.features, frames, undistorter,
                     [&](int done, int keyframes) {
                       progress.Update(done, fmt::format("{} keyframes", keyframes));
                     });
  {
    const ScopedStep step(seconds, "tracking and mapping");
    builder.Start(pair);
    builder.Grow();
  }
  {
    const ScopedStep step(seconds, "global bundle adjustment");
    builder.mapper().AdjustGlobally(builder.map(), options.global_rounds, options.num_threads);
  }
  ImproveMap(options, input, undistorter, builder, seconds);
  SelfCalibrationReport calibration;
  {
    const ScopedStep step(seconds, "self-calibration");
    calibration = Recalibrate(options, frames, undistorter, builder);
  }
  std::vector<FrameTrack> localized;
  {
    const ScopedStep step(seconds, "localising all frames");
    localized = LocalizeFrames(options, builder, builder.map());
  }
  {
    const ScopedStep step(seconds, "export");
    Export(input, calibration.camera, builder.map(), localized, result);
  }
  result.report.camera_was_refined = calibration.accepted;
  result.report.distortion_cost_share = calibration.cost_decrease;
  result.report.initial_frames = {pair.frame_a, pair.frame_b};
  result.report.initial_parallax_deg = pair.parallax_deg;
  result.report.num_relocalizations = builder.num_relocalizations();
  return result;
}

nlohmann::json ToJson(const Report& report) {
  nlohmann::json frames = nlohmann::json::array();
  for (const FrameReport& frame : report.frames) {
    frames.push_back({{"localized", frame.localized},
                      {"keyframe", frame.is_keyframe},
                      {"inliers", frame.num_inliers}});
  }
  return {{"frames", report.num_frames},
          {"frames_localized", report.num_localized},
          {"keyframes", report.num_keyframes},
          {"points", report.num_points},
          {"observations", report.num_observations},
          {"relocalizations", report.num_relocalizations},
          {"rms_px", report.rms_px},
          {"mean_track_length", report.mean_track_length},
          {"initial_frames", report.initial_frames},
          {"initial_parallax_deg", report.initial_parallax_deg},
          {"camera_was_refined", report.camera_was_refined},
          {"distortion_cost_share", report.distortion_cost_share},
          {"seconds", report.seconds},
          {"per_frame", frames}};
}

}  // namespace s3lam::slam
