#include "s3lam/slam/focal_search.h"

#include <algorithm>
#include <cmath>

#include "s3lam/base/log.h"
#include "s3lam/base/parallel.h"
#include "s3lam/slam/map_builder.h"

namespace s3lam {
namespace {

constexpr double kWidePrior = 0.2;          // Relative sigma beyond which one trial is not enough.
constexpr double kFairShare = 0.8;          // Of the frames that another trial tracked.
constexpr double kSureRelativeSigma = 0.2;  // Of a focal length that is believed wherever it is.
constexpr double kNearPriorSigmas = 3.0;    // Within which a less sure one is.
constexpr double kFarSigmas = 2.0;          // Of the prior: what is tried where all else fails.
constexpr int kGlobalRounds = 3;
constexpr int kStarts = 8;  // A wrong camera would have all of them tried, and in vain.
constexpr int kObservations = 10000;

/// Frames [begin, end).
struct Window {
  size_t begin = 0;
  size_t end = 0;
  [[nodiscard]] size_t size() const { return end - begin; }
};

Window WindowAround(size_t middle, size_t size, size_t num_frames) {
  size = std::min(size, num_frames);
  const size_t begin = std::min(middle - std::min(middle, size / 2), num_frames - size);
  return {begin, begin + size};
}

Camera WithFocal(Camera camera, double focal) {
  camera.params[0] = focal;
  return camera;
}

/// As many of the prior's sigmas below and above the guess.
std::vector<Camera> CamerasAside(const Camera& guess, const FocalPrior& prior, double sigmas) {
  const double change = sigmas * prior.relative_sigma;
  return {WithFocal(guess, prior.focal * std::exp(-change)),
          WithFocal(guess, prior.focal * std::exp(change))};
}

/// The guess, and others as far off as it may be.
std::vector<Camera> Candidates(const Camera& guess, const FocalPrior& prior) {
  std::vector<Camera> cameras{guess};
  if (prior.relative_sigma > kWidePrior) {
    for (const Camera& camera : CamerasAside(guess, prior, 1.0)) cameras.push_back(camera);
  }
  return cameras;
}

std::vector<FrameFeatures> UndistortedFrames(const std::vector<FrameFeatures>& frames,
                                             const Window& window, const Undistorter& undistorter) {
  std::vector<FrameFeatures> result(frames.begin() + static_cast<std::ptrdiff_t>(window.begin),
                                    frames.begin() + static_cast<std::ptrdiff_t>(window.end));
  for (FrameFeatures& frame : result) frame.Undistort(undistorter);
  return result;
}

/// Where a map can start, as far as one of the cameras shows it.
std::optional<size_t> FindMiddle(const TrialMapOptions& options,
                                 const std::vector<FrameFeatures>& frames,
                                 const std::vector<Camera>& cameras) {
  for (const Camera& camera : cameras) {
    const Undistorter undistorter(camera);
    const auto undistorted = UndistortedFrames(frames, {0, frames.size()}, undistorter);
    const auto pair =
        FindInitialPair(options.initializer, undistorted, undistorter, options.num_threads);
    if (pair) return static_cast<size_t>(pair->frame_a);
  }
  return std::nullopt;
}

/// A camera adjusted with the map that it gave.
struct Trial {
  CameraRefinement refinement;
  double change = 0.0;  // Of the logarithm of the focal length.
  int num_tracked = 0;  // Frames.
};

class Search {
 public:
  Search(const TrialMapOptions& options, const std::vector<FrameFeatures>& frames,
         const Vocabulary& vocabulary, const FocalPrior& prior)
      : options_(options), frames_(frames), vocabulary_(vocabulary), prior_(prior) {}

  /// Maps some frames with each camera, and anew with what the best gives until that stays; empty
  /// if no map comes of it, or a focal length that cannot be believed.
  [[nodiscard]] std::optional<CameraRefinement> Find(const std::vector<Camera>& cameras,
                                                     const Window& window) const {
    const auto best = Try(cameras, window);
    if (!best) return std::nullopt;
    CameraRefinement found = Settle(*best, window).refinement;
    const bool is_believed = IsBelievable(found, prior_);
    spdlog::info("frames {} to {} suggest a focal length of {:.1f} +- {:.1f} px{}", window.begin,
                 window.end - 1, found.camera.FocalX(), found.focal_sigma,
                 is_believed ? "" : ", which cannot be believed");
    return is_believed ? std::optional(std::move(found)) : std::nullopt;
  }

 private:
  /// The best trial of all cameras, if any gives a map.
  [[nodiscard]] std::optional<Trial> Try(const std::vector<Camera>& cameras,
                                         const Window& window) const {
    std::vector<std::optional<Trial>> trials(cameras.size());
    ParallelFor(cameras.size(), options_.num_threads,
                [&](size_t i) { trials[i] = MapAndRefine(cameras[i], window); });
    int most_tracked = 0;
    for (const auto& trial : trials) {
      if (trial) most_tracked = std::max(most_tracked, trial->num_tracked);
    }
    std::optional<Trial> best;
    for (const auto& trial : trials) {
      if (!trial || trial->num_tracked < kFairShare * most_tracked) continue;
      if (!best || trial->refinement.mean_score > best->refinement.mean_score) best = trial;
    }
    return best;
  }

  /// Maps anew with what came out until that stays.
  [[nodiscard]] Trial Settle(Trial trial, const Window& window) const {
    for (int round = 1;
         round < options_.search.max_rounds && trial.change > options_.search.settled_change;
         ++round) {
      const auto next = MapAndRefine(trial.refinement.camera, window);
      if (!next) break;
      trial = *next;
    }
    return trial;
  }

  [[nodiscard]] std::optional<Trial> MapAndRefine(const Camera& camera,
                                                  const Window& window) const {
    const Undistorter undistorter(camera);
    std::vector<FrameFeatures> frames = UndistortedFrames(frames_, window, undistorter);
    const auto pair = FindInitialPair(options_.initializer, frames, undistorter, 1);
    if (!pair) return std::nullopt;
    MapBuilder builder(options_.tracker, options_.mapper, options_.features, frames, undistorter,
                       vocabulary_, std::vector<uint8_t>(frames.size(), 0));
    builder.Start(*pair);
    builder.Grow();
    builder.mapper().AdjustGlobally(builder.map(), kGlobalRounds, 1);
    const auto refinement = RefineIntrinsics(options_.self_calibration, camera, prior_,
                                             MakeCalibrationProblem(builder.map()));
    if (!refinement) return std::nullopt;
    spdlog::debug(
        "frames {} to {}, focal length {:.1f} px: {} frames tracked, {:.1f} +- {:.1f} px,"
        " mean score {:.4f}",
        window.begin, window.end - 1, camera.FocalX(), builder.NumTracked(),
        refinement->camera.FocalX(), refinement->focal_sigma, refinement->mean_score);
    return Trial{*refinement, std::abs(std::log(refinement->camera.FocalX() / camera.FocalX())),
                 builder.NumTracked()};
  }

  const TrialMapOptions& options_;
  const std::vector<FrameFeatures>& frames_;
  const Vocabulary& vocabulary_;
  const FocalPrior& prior_;
};

}  // namespace

void FocalSearchOptions::Visit(OptionVisitor& v) {
  v.Value("first_frames", first_frames, "frames of the first trial maps", 10, 1000000);
  v.Value("enough_relative_sigma", enough_relative_sigma,
          "relative standard deviation of the focal length that ends the search", 1e-6, 1.0);
  v.Value("settled_change", settled_change,
          "a map is made anew if the focal length it gives differs by more than this share", 1e-6,
          1.0);
  v.Value("max_rounds", max_rounds, "maps of the same frames at the most", 1, 100);
}

std::optional<CameraRefinement> SearchFocal(const TrialMapOptions& given,
                                            const std::vector<FrameFeatures>& frames,
                                            const Vocabulary& vocabulary, const Camera& guess,
                                            const FocalPrior& prior) {
  TrialMapOptions options = given;
  options.initializer.num_starts = std::min(options.initializer.num_starts, kStarts);
  options.self_calibration.max_observations =
      std::min(options.self_calibration.max_observations, kObservations);
  std::vector<Camera> cameras = Candidates(guess, prior);
  const std::vector<Camera> far_cameras = CamerasAside(guess, prior, kFarSigmas);
  auto middle = FindMiddle(options, frames, cameras);
  if (!middle) middle = FindMiddle(options, frames, far_cameras);
  if (!middle) return std::nullopt;
  const Search search(options, frames, vocabulary, prior);
  std::optional<CameraRefinement> best;
  for (auto size = static_cast<size_t>(options.search.first_frames);; size *= 2) {
    const Window window = WindowAround(*middle, size, frames.size());
    auto found = search.Find(cameras, window);
    if (!found && !best) found = search.Find(far_cameras, window);
    if (found) {
      best = std::move(found);
      if (best->focal_sigma < options.search.enough_relative_sigma * best->camera.FocalX()) break;
      cameras = {best->camera};
    }
    if (window.size() == frames.size()) break;
  }
  return best;
}

bool IsBelievable(const CameraRefinement& refinement, const FocalPrior& prior) {
  const double focal = refinement.camera.FocalX();
  return refinement.focal_sigma <= kSureRelativeSigma * focal ||
         std::abs(std::log(focal / prior.focal)) <= kNearPriorSigmas * prior.relative_sigma;
}

CalibrationProblem MakeCalibrationProblem(const Map& map, const PerReadout& per_readout) {
  CalibrationProblem problem;
  std::vector<int> pose_of_keyframe(static_cast<size_t>(map.num_keyframes()), kNoIndex);
  for (int k = 0; k < map.num_keyframes(); ++k) {
    if (!map.keyframe(k).alive) continue;
    pose_of_keyframe[k] = static_cast<int>(problem.poses.size());
    problem.poses.push_back(map.keyframe(k).cam_from_world);
  }
  for (int p = 0; p < map.num_points(); ++p) {
    if (!map.point(p).alive) continue;
    for (const MapObservation& o : map.point(p).observations) {
      const Keypoint& keypoint = map.keypoint(o);
      problem.observations.push_back({pose_of_keyframe[o.keyframe],
                                      static_cast<int>(problem.points.size()),
                                      keypoint.pixel.cast<double>(), 1.0 / keypoint.sigma});
      if (per_readout) problem.observations.back().per_readout = per_readout(o, map.point(p));
    }
    problem.points.push_back(map.point(p).position);
  }
  return problem;
}

void ApplyRefinement(const CameraRefinement& refinement, Map& map) {
  size_t pose = 0;
  for (int k = 0; k < map.num_keyframes(); ++k) {
    if (map.keyframe(k).alive) map.SetPose(k, refinement.poses[pose++]);
  }
  size_t point = 0;
  for (int p = 0; p < map.num_points(); ++p) {
    if (map.point(p).alive) map.SetPosition(p, refinement.points[point++]);
  }
}

}  // namespace s3lam
