#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/base/timer.h"
#include "s3lam/optim/self_calibration.h"
#include "s3lam/scene/descriptor.h"
#include "s3lam/scene/frame_observations.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/trajectory.h"
#include "s3lam/slam/initializer.h"
#include "s3lam/slam/mapper.h"
#include "s3lam/slam/second_pass.h"
#include "s3lam/slam/tracker.h"

namespace s3lam::slam {

struct Options {
  FeatureOptions features;
  InitializerOptions initializer;
  TrackerOptions tracker;
  MapperOptions mapper;
  SecondPassOptions second_pass;
  SelfCalibrationOptions self_calibration;
  int min_localization_inliers = 15;
  int global_rounds = 5;
  int num_threads = 0;  // Not a configuration value: results do not depend on it.

  void Visit(OptionVisitor& v);
};

/// A sequence as the algorithm sees it. The callbacks may be called from several threads at once
/// when `concurrent_reads` is set.
struct Input {
  Camera camera;
  std::vector<double> times_s;                // Per frame, increasing.
  std::vector<std::string> names;             // Per frame, unique.
  std::function<cv::Mat(size_t)> read_gray;   // 8-bit, one channel
  std::function<cv::Mat(size_t)> read_color;  // 8-bit, one or three (BGR) channels
  std::function<cv::Mat(size_t)> read_mask;   // Optional: 8-bit, 0 where nothing may be used
  bool concurrent_reads = true;
};

/// How well one frame is known.
struct FrameReport {
  bool localized = false;
  bool is_keyframe = false;
  int num_inliers = 0;  // Points seen.
};

struct Report {
  int num_frames = 0;
  int num_localized = 0;
  int num_keyframes = 0;
  int num_points = 0;
  int num_observations = 0;
  int num_relocalizations = 0;
  double rms_px = 0.0;
  double mean_track_length = 0.0;
  bool camera_was_refined = false;
  double distortion_cost_share = 0.0;  // What a refined distortion would remove of the cost.
  std::array<int, 2> initial_frames{-1, -1};
  double initial_parallax_deg = 0.0;
  std::vector<FrameReport> frames;
  StepTimes seconds;
};
nlohmann::json ToJson(const Report& report);

struct Result {
  Reconstruction reconstruction;  // Keyframes only; image ids ascend in time.
  PointDescriptors descriptors;
  Trajectory keyframes;  // world_from_camera, ascending time: one per image of the reconstruction.
  Trajectory frames;     // All localised frames.
  FrameObservations observations;  // What localised frames that are no keyframes see.
  Report report;
};

/// Monocular keyframe SLAM over a whole sequence:
///   extract features -> find the initial pair -> track and map, both ways -> adjust everything ->
///   localise every frame in the final map -> export.
/// Throws InputError if no map can be started or images do not fit the camera.
Result Run(const Options& options, const Input& input);

}  // namespace s3lam::slam
