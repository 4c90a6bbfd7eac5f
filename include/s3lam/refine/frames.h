#pragma once

#include <span>

#include "s3lam/geometry/rigid3.h"
#include "s3lam/scene/trajectory.h"

namespace s3lam {

/// A keyframe before and after refinement.
struct MovedKeyframe {
  double time_s = 0.0;
  Rigid3 old_cam_from_world;
  Rigid3 new_cam_from_world;
};

/// Carries poses along with the keyframes around them in time: each keeps its place relative to the
/// keyframe before and the one after, both with the local change of scale between the two, and the
/// two answers are blended by time. Outside the keyframes' times the nearest one counts alone. A
/// pose at a keyframe's time moves exactly as the keyframe does. Keyframes in any order; without
/// any, nothing moves.
Trajectory CarryFrames(const Trajectory& frames, std::span<const MovedKeyframe> keyframes);

}  // namespace s3lam
