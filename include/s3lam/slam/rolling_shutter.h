#pragma once

#include <Eigen/Core>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/optim/self_calibration.h"
#include "s3lam/slam/map.h"
#include "s3lam/slam/tracker.h"

namespace s3lam {

/// The order in which the lines of an image are exposed, first to last, in the image as it is read:
/// that of a phone held upright has its columns exposed one after another.
enum class ShutterDirection { kDown, kUp, kRight, kLeft };

struct RollingShutterOptions {
  enum class Mode { kOff, kCheck, kCompensate };
  Mode mode = Mode::kCheck;
  double readout_s = 0.0;  // 0: estimated, and the direction with it.
  ShutterDirection direction = ShutterDirection::kDown;

  void Visit(OptionVisitor& v);
};

/// "down", "up", "right", "left".
std::string_view ShutterDirectionName(ShutterDirection direction);

/// How long after the middle of an image its pixels are exposed: per width of the image to the
/// right of it, per height below it [s]. Zero: a global shutter.
using Readout = Eigen::Vector2d;
Readout MakeReadout(double readout_s, ShutterDirection direction);
ShutterDirection DirectionOf(const Readout& readout);

/// How the camera moves around a frame: the polynomial through where it is at that frame and at up
/// to two on either side, of every point in the coordinates of the camera. (The difference of the
/// frames beside it alone would miss a quarter of what a hand shakes at 6 Hz and 30 frames/s.)
class FrameMotion {
 public:
  struct Pose {
    double time_s = 0.0;  // After the frame; that of the frame itself is zero.
    Rigid3 cam_from_world;
  };
  /// At least two poses at different times, that of the frame among them.
  explicit FrameMotion(std::vector<Pose> poses) : poses_(std::move(poses)) {}

  /// Of a point in the coordinates of the camera, at the time of the frame [map units/s].
  [[nodiscard]] Eigen::Vector3d VelocityOf(const Eigen::Vector3d& point_in_world) const;
  /// Where the camera has the point so much later.
  [[nodiscard]] Eigen::Vector3d PointAfter(double time_s,
                                           const Eigen::Vector3d& point_in_world) const;

 private:
  std::vector<Pose> poses_;
};

/// Per frame; none where no frame beside it is localised, or only much later or earlier.
std::vector<std::optional<FrameMotion>> FindMotions(const std::vector<double>& times_s,
                                                    const std::vector<FrameTrack>& localized);

/// A map and how the camera moves at its frames.
struct MapInMotion {
  const Map& map;
  const std::vector<std::optional<FrameMotion>>& motions;
};

/// What of the reprojection cost of the keyframes a readout time along an axis of the image alone
/// would remove, beyond the one that keypoints are corrected by; points held, poses free. Points
/// that were adjusted without it explain a part of it away: these are lower bounds. Zero where
/// fewer than eight keyframes see enough.
struct ReadoutShares {
  double right = 0.0;  // Along x.
  double down = 0.0;   // Along y.
};
ReadoutShares FindReadoutShares(const Undistorter& undistorter,
                                const std::vector<MapInMotion>& maps);

/// What keyframes see, with how far a readout time along an axis of the image would move it.
CalibrationProblem MakeReadoutProblem(const Undistorter& undistorter, const MapInMotion& map,
                                      const Eigen::Vector2d& axis);

/// Moves keypoints to where a global shutter would have put them.
class ShutterCorrection {
 public:
  /// The first so many frames, with their keypoints where they were found.
  ShutterCorrection(const Map& map, size_t num_frames);

  /// From where they were found, whatever was applied before; keypoints without a point are taken
  /// for as far away as the median one. Those of frames without a motion are left where they were
  /// found.
  void Apply(const Readout& readout, const Undistorter& undistorter,
             const std::vector<FrameTrack>& localized,
             const std::vector<std::optional<FrameMotion>>& motions, Map& map) const;

 private:
  struct Place {
    Eigen::Vector2f pixel;
    Eigen::Vector2f undistorted;
  };
  /// Empty where no camera has the pixel.
  [[nodiscard]] static std::optional<Place> Correct(const Place& found, double depth,
                                                    const Readout& readout,
                                                    const Undistorter& undistorter,
                                                    const Rigid3& cam_from_world,
                                                    const FrameMotion& motion);

  std::vector<std::vector<Place>> places_;  // By frame, by keypoint.
};

}  // namespace s3lam
