#pragma once

#include <optional>
#include <span>
#include <vector>

#include "s3lam/geometry/rigid3.h"

namespace s3lam::slam {

/// Where a localised frame is, in its map.
struct FrameView {
  int map = -1;
  Rigid3 cam_from_world;
  double median_depth = 0.0;  // Of the points that it sees.
};

/// Frames in a row from which nothing can be triangulated: the camera's centre stays, so that
/// points move by less than a pixel for it. It turns if they move by more for the turn in most of
/// these frames.
struct StopReport {
  enum class Kind { kStandstill, kRotation };  // Does the view stay as well, or turn?
  int first_frame = 0;
  int last_frame = 0;
  int map = -1;
  Kind kind = Kind::kStandstill;
  double turn_deg = 0.0;  // From the first frame to the one turned farthest from it.
};

/// Stops of ten frames or more; `views` has one per frame of the sequence, empty if it is not
/// localised. `focal_length` [px].
std::vector<StopReport> FindStops(std::span<const std::optional<FrameView>> views,
                                  double focal_length);

}  // namespace s3lam::slam
