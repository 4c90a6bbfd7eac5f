#pragma once

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "s3lam/base/timer.h"
#include "s3lam/slam/loop_closer.h"
#include "s3lam/slam/remapping.h"
#include "s3lam/slam/rolling_shutter.h"
#include "s3lam/slam/stops.h"

namespace s3lam::slam {

/// How well one frame is known.
struct FrameReport {
  int map = -1;  // Of Result::models; negative if it is not localised.
  bool is_keyframe = false;
  int num_inliers = 0;         // Points seen.
  double spread = 0.0;         // Share of the image, by cells of a grid, that they cover.
  double rms_sigma = 0.0;      // Their reprojection error in standard deviations.
  double contradiction = 0.0;  // Of the map by two views around it, see TwoViewCheck.
  bool is_cut_off = false;     // From most of its map, by frames that two views refute.
  double trust = 0.0;          // In [0, 1], see FrameTrust.

  [[nodiscard]] bool localized() const { return map >= 0; }
};

/// Frames in a row that are known alike.
struct StretchReport {
  enum class State { kLost, kWeak, kGood };
  /// The factors of FrameTrust, in its order.
  enum class Doubt { kFewPoints, kSmallPart, kLargeResiduals, kRefuted, kCutOff };
  int first_frame = 0;
  int last_frame = 0;
  int map = -1;
  State state = State::kLost;  // Good if and only if the mean trust is.
  double mean_trust = 0.0;
  double min_trust = 0.0;
  std::optional<Doubt> doubt;  // What lowers the trust of a weak one most.
};
/// Such as "few points".
const char* Describe(StretchReport::Doubt doubt);

/// One map: a model of its own, in a world and scale of its own.
struct MapReport {
  int num_frames = 0;
  int num_keyframes = 0;
  int num_points = 0;
  int num_observations = 0;
  int num_relocalizations = 0;
  double rms_px = 0.0;
  std::vector<double> aligned_sigmas_px;  // Of keypoints aligned by patches, by level.
  double mean_track_length = 0.0;
  int first_frame = -1;
  int last_frame = -1;
  std::array<int, 2> initial_frames{-1, -1};
  double initial_parallax_deg = 0.0;
  /// Of the initial pair, over all tracks, in sigma, capped: what the motion taken leaves, what a
  /// mere rotation would, and what the next best of the other motions that would do as well would.
  /// Such motions are the mark of a plane: its homography allows for two.
  double initial_error = 0.0;
  double initial_rotation_only_error = 0.0;
  int initial_other_motions = 0;
  double initial_other_error = 0.0;
  LoopClosingReport loops;
};

/// The focal length of a camera that was not known [px].
struct FocalReport {
  double guess = 0.0;
  double guess_relative_sigma = 0.0;
  double refined = 0.0;
  double noise_sigma = 0.0;  // By the keypoints' noise alone.
  double parts_sigma = 0.0;  // By how parts of the sequence differ, see FocalSigmaBetweenParts.

  /// [px] Both, and 1 % for what all parts have in common.
  [[nodiscard]] double Sigma() const;
  /// False where the motion, e.g. a straight one, leaves the focal length near to a guess.
  [[nodiscard]] bool IsDetermined() const;
};

/// Whether the lines of the images were exposed one after another.
struct RollingShutterReport {
  bool is_seen = false;
  double cost_share = 0.0;  // What a readout time removes of the reprojection cost.
  bool is_compensated = false;
  double readout_s = 0.0;  // From the first line to the last.
  double sigma_s = 0.0;    // By the noise of the keypoints; zero if the readout time was given.
  ShutterDirection direction = ShutterDirection::kDown;
};

struct Report {
  int num_frames = 0;                // Of the sequence.
  std::vector<MapReport> maps;       // As Result::models: the largest first.
  RemappingReport remapping;         // Other starts, where two views refuted the maps.
  int num_merged_maps = 0;           // Maps that were begun apart and became part of another.
  std::optional<FocalReport> focal;  // Unless the camera was known.
  bool camera_was_refined = false;
  /// Of a known camera, unless that is switched off; the three figures below are of this check.
  bool calibration_was_checked = false;
  double distortion_cost_share = 0.0;  // What a refined distortion would remove of the cost.
  /// What other focal lengths and another principal point would remove of the rest, and fx, fy, cx,
  /// cy [px] of these if they put the given ones in doubt, see CheckCalibration; none where the map
  /// is mostly refuted or a rolling shutter, which looks alike, is seen and not corrected for.
  double pinhole_cost_share = 0.0;
  std::vector<double> better_pinhole;
  std::optional<RollingShutterReport> rolling_shutter;  // If it was looked for.
  std::vector<FrameReport> frames;
  std::vector<StretchReport> stretches;  // All frames, in order.
  std::vector<StopReport> stops;
  StepTimes seconds;
};
nlohmann::json ToJson(const Report& report);

/// Whether the camera was not known, and so many frames are in no map that it may be why: those
/// lost under a wrong focal length are not all found again when it is refined.
bool LosesFramesOfUnknownCamera(const Report& report);

/// Product of five factors that are one where nothing is in doubt: points seen / 60, share of the
/// image they cover / 0.5, 1 / reprojection RMS in sigma, each at most one, 1 - contradiction
/// / 0.04, at least zero, and 0.4 where a frame is cut off: it may fit its neighbours, but its
/// place and scale in the map are a guess.
double FrameTrust(const FrameReport& frame);

/// Do two views refute the first map in most of its frames?
bool IsMostlyRefuted(const std::vector<FrameReport>& frames);

/// Cuts the sequence where the map changes, and where the trust crosses one half for more than a
/// few frames, or so far that these would belie what is said of those around them.
std::vector<StretchReport> FindStretches(const std::vector<FrameReport>& frames);

}  // namespace s3lam::slam
