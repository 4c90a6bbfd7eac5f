#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/base/step_store.h"
#include "s3lam/optim/self_calibration.h"
#include "s3lam/scene/descriptor.h"
#include "s3lam/scene/frame_observations.h"
#include "s3lam/scene/keypoint_sigmas.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/trajectory.h"
#include "s3lam/slam/focal_search.h"
#include "s3lam/slam/initializer.h"
#include "s3lam/slam/mapper.h"
#include "s3lam/slam/remapping.h"
#include "s3lam/slam/report.h"
#include "s3lam/slam/rolling_shutter.h"
#include "s3lam/slam/second_pass.h"
#include "s3lam/slam/submaps.h"
#include "s3lam/slam/tracker.h"
#include "s3lam/slam/two_view_check.h"

namespace s3lam::slam {

/// What a run may cost: fast leaves out the steps that Effective() names.
enum class Accuracy { kFast, kHigh };

struct Options {
  Accuracy accuracy = Accuracy::kHigh;
  FeatureOptions features;
  InitializerOptions initializer;
  TrackerOptions tracker;
  MapperOptions mapper;
  VocabularyOptions vocabulary;
  SubmapOptions submaps;
  RemappingOptions remapping;
  LoopClosingOptions loops;
  SecondPassOptions second_pass;
  FocalSearchOptions focal_search;
  SelfCalibrationOptions self_calibration;
  RollingShutterOptions rolling_shutter;
  TwoViewCheckOptions two_view_check;
  int min_localization_inliers = 15;
  int global_rounds = 5;
  int num_threads = 0;  // Not a configuration value: results do not depend on it.
  uint64_t seed = 0;    // From the command line, of all samples that are drawn.

  void Visit(OptionVisitor& v);
};

/// The options as a run uses them: what its accuracy leaves out is switched off, and every step has
/// the seed.
Options Effective(const Options& options);

/// A sequence as the algorithm sees it. The callbacks may be called from several threads at once
/// when `concurrent_reads` is set.
struct Input {
  Camera camera;
  /// Set if the camera is a guess, SIMPLE_RADIAL or RADIAL, that is to be refined.
  std::optional<FocalPrior> focal_prior;
  std::vector<double> times_s;                // Per frame, increasing.
  std::vector<std::string> names;             // Per frame, unique.
  std::function<cv::Mat(size_t)> read_gray;   // 8-bit, one channel
  std::function<cv::Mat(size_t)> read_color;  // 8-bit, one or three (BGR) channels
  std::function<cv::Mat(size_t)> read_mask;   // Optional: 8-bit, 0 where nothing may be used
  bool concurrent_reads = true;
  /// Where the state is kept, for a run that can be gone on with: after each step and, while
  /// tracking, as often as this [s].
  StepStore* steps = nullptr;
  double save_every_s = 30.0;
};

/// One map as it goes to disk.
struct Model {
  Reconstruction reconstruction;  // Keyframes only; image ids ascend in time.
  PointDescriptors descriptors;
  KeypointSigmas keypoint_sigmas;
  Trajectory keyframes;  // world_from_camera, ascending time: one per image of the reconstruction.
  Trajectory frames;     // All localised frames.
  FrameObservations observations;  // What localised frames that are no keyframes see.
};

struct Result {
  std::vector<Model> models;  // The largest first; more than one where the sequence fell apart.
  Report report;
};

/// Monocular keyframe SLAM over a whole sequence:
///   extract features -> learn a vocabulary from them -> if the camera is a guess, look for its
///   focal length on a stretch of frames -> from an initial pair, track and map, both
///   ways; start over where that gets lost for good -> merge maps that meet -> map again
///   from elsewhere where two views refute the map, its loops closed -> close loops ->
///   match again and align, adjusting in between -> refine the camera -> adjust with the noise that
///   aligned keypoints have -> localise every frame in the final maps -> look for a rolling
///   shutter, and correct for it if asked to -> export.
/// Throws InputError if no map can be started or images do not fit the camera.
Result Run(const Options& options, const Input& input);

}  // namespace s3lam::slam
