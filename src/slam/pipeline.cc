#include "s3lam/slam/pipeline.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>

#include "calibration_steps.h"
#include "localization_steps.h"
#include "report_steps.h"
#include "rolling_shutter_steps.h"
#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/progress.h"
#include "s3lam/base/statistics.h"
#include "s3lam/slam/export.h"
#include "s3lam/slam/run_state.h"
#include "s3lam/slam/stops.h"

namespace s3lam::slam {
namespace {

/// Bundle adjustments between steps of aligning: AdjustAligned comes after those.
constexpr int kRoundsBetween = 1;
constexpr double kFastKeyframeRatio = 0.75;
constexpr double kFastCoverage = 0.7;
constexpr std::array<std::string_view, 2> kAccuracyNames{"fast", "high"};

std::vector<FrameFeatures> ExtractAll(const Options& options, const Input& input,
                                      const Undistorter& undistorter) {
  std::vector<FrameFeatures> frames(input.names.size());
  Progress progress("features", static_cast<int64_t>(frames.size()));
  std::mutex mutex;
  int64_t done = 0;
  ParallelFor(frames.size(), input.concurrent_reads ? options.num_threads : 1, [&](size_t i) {
    const cv::Mat gray = input.read_gray(i);
    if (gray.cols != input.camera.width || gray.rows != input.camera.height) {
      ThrowInputError(
          "{}: image is {} x {}, but the camera is for {} x {}: give the calibration of these "
          "images",
          input.names[i], gray.cols, gray.rows, input.camera.width, input.camera.height);
    }
    const cv::Mat mask = input.read_mask ? input.read_mask(i) : cv::Mat();
    frames[i] = ExtractFeatures(options.features, undistorter, gray, mask);
    const std::lock_guard lock(mutex);
    progress.Update(++done);
  });
  return frames;
}

/// One map, or several where the sequence falls apart; `keep` is called between frames.
Submaps BuildMaps(const Options& options, const MapBuilderFactory& make_builder,
                  const RunState& state, const std::function<void()>& keep,
                  SubmapsUnderWay& tracking) {
  Progress progress("tracking", static_cast<int64_t>(state.frames.size()));
  const auto after_frame = [&] {
    int done = tracking.growing->NumTracked();
    for (const auto& map : tracking.maps) done += map->NumTracked();
    progress.Update(done, fmt::format("{} keyframes", tracking.growing->map().num_keyframes()));
    keep();
  };
  return BuildSubmaps(options.submaps, options.initializer, state.frames, state.undistorter,
                      options.num_threads, make_builder, after_frame, tracking);
}

LoopClosingReport CloseLoopsOf(const Options& options, const Vocabulary& vocabulary,
                               const Undistorter& undistorter, MapBuilder& builder) {
  return CloseLoops(options.loops, vocabulary, undistorter, builder.mapper(), options.global_rounds,
                    options.num_threads, builder.map(), builder.tracks());
}

/// Maps of the whole sequence from another start, where these are refuted. Their loops are closed
/// then.
void MapAgain(const Options& options, const MapBuilderFactory& make_builder,
              const Vocabulary& vocabulary, RunState& state) {
  MappedSequence mapped{std::move(state.maps), state.report.num_merged_maps, {}};
  const auto map_from = [&](const FrameSpan& start) {
    MappedSequence again;
    SubmapsUnderWay tracking;
    tracking.start = start;
    again.maps = BuildMaps(
        options, make_builder, state, [] {}, tracking);
    AdjustMaps(options, again.maps);
    again.num_merged = MergeSubmaps(options.submaps, options.loops, vocabulary, state.undistorter,
                                    options.global_rounds, options.num_threads, again.maps);
    return again;
  };
  const auto close_loops = [&](MappedSequence& sequence) {
    for (const auto& builder : sequence.maps) {
      sequence.loops.push_back(CloseLoopsOf(options, vocabulary, state.undistorter, *builder));
    }
  };
  state.report.remapping =
      MapAgainWhereRefuted(options.remapping, state.undistorter, options.num_threads,
                           state.frames.size(), map_from, mapped, close_loops);
  state.maps = std::move(mapped.maps);
  state.loops = std::move(mapped.loops);
  state.report.num_merged_maps = mapped.num_merged;
}

/// Maps of the whole sequence, adjusted, and merged where they meet.
void MapSequence(const Options& options, const MapBuilderFactory& make_builder,
                 const Vocabulary& vocabulary, Steps& steps, RunState& state) {
  StepTimes& seconds = state.report.seconds;
  steps.Do([&] {
    const ScopedStep step(seconds, "tracking and mapping");
    state.maps.clear();
    state.loops.clear();
    state.maps = BuildMaps(
        options, make_builder, state, [&] { steps.KeepNowAndThen(); }, state.tracking);
    if (state.maps.empty()) {
      throw InputError(
          "no pair of frames gives a map to start from: too few matches, too little overlap of "
          "consecutive images, or no parallax (is the camera moving, are the calibration and the "
          "order of the images right?)");
    }
    state.tracking = {};
  });
  steps.Do([&] {
    const ScopedStep step(seconds, "global bundle adjustment");
    AdjustMaps(options, state.maps);
  });
  steps.Do([&] {
    const ScopedStep step(seconds, "merging maps");
    state.report.num_merged_maps =
        MergeSubmaps(options.submaps, options.loops, vocabulary, state.undistorter,
                     options.global_rounds, options.num_threads, state.maps);
  });
  steps.Do([&] {
    const ScopedStep step(seconds, "mapping again where refuted");
    MapAgain(options, make_builder, vocabulary, state);
  });
}

/// The second pass: everything matched again, then every observation aligned, each followed by a
/// bundle adjustment of the whole map.
void ImproveMap(const Options& options, const Input& input, const Undistorter& undistorter,
                MapBuilder& builder, StepTimes& seconds) {
  Map& map = builder.map();
  const FrameImages images{input.read_gray, input.read_mask};
  const int read_threads = input.concurrent_reads ? options.num_threads : 1;
  const auto adjust = [&](int rounds) {
    const ScopedStep step(seconds, "global bundle adjustment");
    builder.mapper().AdjustGlobally(map, rounds, options.num_threads);
  };
  {
    const ScopedStep step(seconds, "features of keyframes");
    AddKeyframeFeatures(options.second_pass, options.features, undistorter, images, read_threads,
                        map);
  }
  for (int round = 0; round < options.second_pass.rounds; ++round) {
    {
      const ScopedStep step(seconds, "matching again");
      MatchAgain(options.second_pass, builder.mapper(), map);
    }
    adjust(options.global_rounds);
  }
  if (!options.second_pass.patches.enabled) return;
  std::optional<PatchPass> pass;
  const auto align = [&] {
    {
      const ScopedStep step(seconds, "aligning patches");
      if (!pass) {
        pass.emplace(options.second_pass, options.features, undistorter, images, read_threads, map);
      }
      const PatchRefinement refinement = pass->RefineObservations(map);
      spdlog::info("{} of {} observations aligned", refinement.num_refined, refinement.num_tried);
    }
    adjust(kRoundsBetween);
  };
  align();
  if (options.second_pass.extend_tracks) {
    {
      const ScopedStep step(seconds, "extending tracks");
      spdlog::info("{} observations found by patches", pass->ExtendTracks(map));
    }
    adjust(kRoundsBetween);
  }
  if (options.second_pass.align_again) align();
}

/// Maps the whole sequence anew as long as that changes the camera.
void MapUntilCameraStays(const Options& options, const FocalPrior& prior,
                         const MapBuilderFactory& make_builder, const Vocabulary& vocabulary,
                         Steps& steps, RunState& state) {
  for (size_t round = 0;; ++round) {
    steps.Do([&] {
      const ScopedStep step(state.report.seconds, "self-calibration");
      const double before = state.undistorter.camera().FocalX();
      RefineCamera(options, prior, state.frames, state.undistorter, state.maps,
                   *state.report.focal);
      const double change = std::abs(std::log(state.undistorter.camera().FocalX() / before));
      state.camera_stays.push_back(change < options.focal_search.settled_change ||
                                   static_cast<int>(round) + 1 >= options.focal_search.max_rounds);
    });
    if (state.camera_stays[round] != 0) return;
    MapSequence(options, make_builder, vocabulary, steps, state);
  }
}

/// What a rolling shutter does passes for a lens distortion, too: what corrects for the one comes
/// before the other.
bool Compensates(const Options& options) {
  return options.rolling_shutter.mode == RollingShutterOptions::Mode::kCompensate;
}

/// All frames in the final maps, which a rolling shutter that is corrected for changes once more.
std::vector<std::vector<FrameTrack>> LocalizeAll(const Options& options, const Input& input,
                                                 RunState& state) {
  StepTimes& seconds = state.report.seconds;
  const Submaps& maps = state.maps;
  std::vector<std::vector<FrameTrack>> localized;
  {
    const ScopedStep step(seconds, "localising all frames");
    localized = LocalizeInMaps(options, input, state.undistorter, maps, state.frames.size());
  }
  const ScopedStep step(seconds, "rolling shutter");
  HandleRollingShutter(options, input, state.undistorter, maps, localized, state.report);
  if (!Compensates(options)) return localized;
  Calibrate(options, input, state);
  AdjustFinally(options, state.undistorter, maps);
  EraseWeakKeyframes(options, maps);
  RefineInMaps(options, maps, localized);
  return localized;
}

/// A shutter that is open for longer than from image to image is none.
void CheckReadout(const Options& options, const std::vector<double>& times_s) {
  if (!Compensates(options)) return;
  const double readout_s = options.rolling_shutter.readout_s;
  const double interval_s = MedianStep(times_s);
  if (readout_s <= interval_s) return;
  ThrowInputError("rolling_shutter.readout_s is {} s, longer than the {:.3g} s from image to image",
                  readout_s, interval_s);
}

}  // namespace

void Options::Visit(OptionVisitor& v) {
  v.Choice(
      "accuracy", accuracy, kAccuracyNames,
      "fast leaves out the keyframes' additional keypoints, the alignment of patches, the check "
      "of the calibration, with it the refinement of the lens distortion, and other starts, and "
      "lowers tracker.keyframe_ratio to 0.75 and tracker.min_coverage to 0.7 at the most");
  v.Group("features", features, "keypoints");
  v.Group("initializer", initializer, "the pair of frames that the map starts from");
  v.Group("tracker", tracker, "localising frames in the map");
  v.Group("mapper", mapper, "growing and pruning the map");
  v.Group("vocabulary", vocabulary, "words for recognising places, learnt from the sequence");
  v.Group("submaps", submaps, "maps begun anew where tracking was lost, and their merging");
  v.Group("remapping", remapping, "other starts where two views refute the map");
  v.Group("loops", loops, "places seen before");
  v.Group("second_pass", second_pass, "what knowing the whole map adds");
  v.Group("focal_search", focal_search, "of a camera that is not known");
  v.Group("self_calibration", self_calibration,
          "check of the calibration, refinement of the lens distortion");
  v.Group("rolling_shutter", rolling_shutter, "images whose lines are exposed one after another");
  v.Group("two_view_check", two_view_check, "signs that a map is bent, for the report");
  v.Value("min_localization_inliers", min_localization_inliers,
          "points that a frame must see in the final map to be localised", 6, 10000);
  v.Value("global_rounds", global_rounds,
          "bundle adjustments of the whole map, outliers removed in between, at the most", 1, 100);
}

Options Effective(const Options& options) {
  Options result = options;
  if (options.accuracy == Accuracy::kFast) {
    result.remapping.max_attempts = 0;
    result.second_pass.keyframe_features = 0;
    result.second_pass.patches.enabled = false;
    result.self_calibration.enabled = false;
    result.tracker.keyframe_ratio = std::min(result.tracker.keyframe_ratio, kFastKeyframeRatio);
    result.tracker.min_coverage = std::min(result.tracker.min_coverage, kFastCoverage);
  }
  for (uint64_t* seed :
       {&result.initializer.seed, &result.tracker.seed, &result.vocabulary.seed,
        &result.remapping.seed, &result.loops.verification.seed, &result.two_view_check.seed}) {
    *seed = options.seed;
  }
  return result;
}

Result Run(const Options& given, const Input& input) {
  const Options options = Effective(given);
  S3LAM_CHECK(input.times_s.size() == input.names.size());
  S3LAM_CHECK(std::adjacent_find(input.times_s.begin(), input.times_s.end(),
                                 std::greater_equal<>()) == input.times_s.end());
  if (input.names.size() < 4)
    ThrowInputError("a sequence of {} images is too short: a map needs at least 4",
                    input.names.size());
  CheckReadout(options, input.times_s);
  RunState state{{}, Undistorter(input.camera), {}, {}, {}, {}, {}};
  StepTimes& seconds = state.report.seconds;
  {
    const ScopedStep step(seconds, "features");
    state.frames =
        KeptFeatures(input.steps, [&] { return ExtractAll(options, input, state.undistorter); });
  }
  std::optional<Vocabulary> vocabulary;
  {
    const ScopedStep step(seconds, "learning words");
    vocabulary.emplace(options.vocabulary, state.frames);
  }
  const MapBuilderFactory make_builder = [&](std::vector<uint8_t> frame_is_taken) {
    return std::make_unique<MapBuilder>(options.tracker, options.mapper, options.features,
                                        state.frames, state.undistorter, *vocabulary,
                                        std::move(frame_is_taken));
  };
  Steps steps(input.steps, input.save_every_s, make_builder, state);
  if (input.focal_prior) {
    steps.Do([&] {
      const ScopedStep step(seconds, "searching the focal length");
      state.report.focal =
          SearchCamera(options, input, *vocabulary, state.frames, state.undistorter);
    });
  }
  MapSequence(options, make_builder, *vocabulary, steps, state);
  if (input.focal_prior) {
    MapUntilCameraStays(options, *input.focal_prior, make_builder, *vocabulary, steps, state);
  }
  const Submaps& maps = state.maps;
  for (size_t m = 0; m < maps.size(); ++m) {
    MapBuilder& builder = *maps[m];
    steps.Do([&] {
      if (m < state.loops.size()) return;  // Closed before the map was judged.
      const ScopedStep step(seconds, "closing loops");
      state.loops.push_back(CloseLoopsOf(options, *vocabulary, state.undistorter, builder));
    });
    steps.Do([&] { ImproveMap(options, input, state.undistorter, builder, seconds); });
  }
  steps.Do([&] {
    const ScopedStep step(seconds, "self-calibration");
    if (!Compensates(options)) Calibrate(options, input, state);
  });
  steps.Do([&] {
    const ScopedStep step(seconds, "global bundle adjustment");
    AdjustAligned(options, state.undistorter, maps);
    EraseWeakKeyframes(options, maps);
  });
  const auto localized = LocalizeAll(options, input, state);
  std::vector<TwoViewVerdict> verdicts;
  {
    const ScopedStep step(seconds, "two-view check");
    verdicts = JudgeMaps(options, state.undistorter, maps, localized);
  }
  const ScopedStep step(seconds, "export");
  return MakeResult(options, input, localized, verdicts, state);
}

}  // namespace s3lam::slam
