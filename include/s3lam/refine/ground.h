#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/refine/plane_model.h"

namespace s3lam {

enum class CameraHeightMode { kAuto, kOn, kOff };
/// What of the cameras may follow the heights.
enum class RefinedWithHeights { kNone, kDistortion, kAll };

/// The camera of a vehicle or robot keeps its height above the ground, which removes the drift of
/// the scale of a monocular map.
struct CameraHeightOptions {
  CameraHeightMode mode = CameraHeightMode::kAuto;
  std::string ground_class = "road";
  double value = 0.0;
  /// Of a car's 1.65 m: 8 mm heave, 10 mm from pitch (0.6 deg a metre ahead of the middle of the
  /// axles), 10 mm uneven road, together 16 mm.
  double sigma_relative = 0.01;
  double plane_length_heights = 8.0;
  double max_bend_deg = 1.0;
  double max_step_relative = 0.01;
  double auto_max_spread = 0.05;
  double auto_min_coverage = 0.5;
  int min_points = 20;
  /// Where the heights vary by more than sigma_relative.
  RefinedWithHeights refine_camera = RefinedWithHeights::kAll;
  uint64_t seed = 0;  // Of the samples drawn; from the command line.

  void Visit(OptionVisitor& v);
};

/// What was found under the cameras.
struct GroundReport {
  bool in_use = false;
  std::string reason;  // Why not, if not.
  size_t num_planes = 0;
  size_t num_cameras = 0;      // With a height term.
  double height = 0.0;         // Median before, common height after [map units].
  double spread_before = 0.0;  // Standard deviation of the heights, relative.
  double spread_after = 0.0;
};

/// Cuts the path of the cameras (images by ascending id) into stretches of plane_length_heights
/// camera heights and fits a plane to the ground points under each. They become planes of the model
/// in the place of all others of the ground's class, each tied to the next (it may bend by
/// max_bend_deg and step by max_step_relative of the height, one sigma), and every camera above one
/// gets a height term, unless the ground's points lie too far aside to tell its height. Leaves
/// model and problem as they were, and says why, if there is no ground to be found or, in mode
/// auto, the camera does not keep its height above it well enough.
GroundReport AddGround(const CameraHeightOptions& options, const SemanticMap& semantics,
                       double sigma_px, PlaneModel& model, BundleMap& map);

}  // namespace s3lam
