#pragma once

#include <vector>

#include "s3lam/geometry/rigid3.h"

namespace s3lam {

struct TimedPose {
  double time_s = 0.0;
  Rigid3 world_from_camera;
};

/// Poses by strictly increasing time.
using Trajectory = std::vector<TimedPose>;

}  // namespace s3lam
