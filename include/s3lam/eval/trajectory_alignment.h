#pragma once

#include <array>
#include <optional>
#include <span>
#include <string_view>

#include "s3lam/eval/pose_errors.h"
#include "s3lam/geometry/similarity3.h"

namespace s3lam {

/// What of the difference between estimate and ground truth is free: a similarity (a monocular
/// estimate), a rigid transform, nothing.
enum class TrajectoryAlignment { kSim3, kSe3, kNone };

/// In the order of the enumerators.
inline constexpr std::array<std::string_view, 3> kTrajectoryAlignmentNames{"sim3", "se3", "none"};

std::optional<TrajectoryAlignment> TrajectoryAlignmentFromName(std::string_view name);
std::string_view TrajectoryAlignmentName(TrajectoryAlignment alignment);

/// truth_from_estimate that brings the camera centres of the estimates nearest to those of the
/// truth (Umeyama). Empty if there are fewer than three pairs or the centres leave it undetermined.
std::optional<Similarity3> AlignPosePairs(std::span<const PosePair> pairs,
                                          TrajectoryAlignment alignment);

}  // namespace s3lam
