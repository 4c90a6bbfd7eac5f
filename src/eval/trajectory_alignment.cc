#include "s3lam/eval/trajectory_alignment.h"

#include <vector>

#include "s3lam/geometry/alignment.h"

namespace s3lam {
namespace {

/// Fewer say nothing, and do not determine an alignment.
constexpr size_t kMinPairs = 3;

}  // namespace

std::optional<TrajectoryAlignment> TrajectoryAlignmentFromName(std::string_view name) {
  for (size_t i = 0; i < kTrajectoryAlignmentNames.size(); ++i) {
    if (kTrajectoryAlignmentNames[i] == name) return static_cast<TrajectoryAlignment>(i);
  }
  return std::nullopt;
}

std::string_view TrajectoryAlignmentName(TrajectoryAlignment alignment) {
  return kTrajectoryAlignmentNames.at(static_cast<size_t>(alignment));
}

std::optional<Similarity3> AlignPosePairs(std::span<const PosePair> pairs,
                                          TrajectoryAlignment alignment) {
  if (pairs.size() < kMinPairs) return std::nullopt;
  if (alignment == TrajectoryAlignment::kNone) return Similarity3();
  std::vector<Eigen::Vector3d> truth;
  std::vector<Eigen::Vector3d> estimate;
  for (const PosePair& pair : pairs) {
    truth.push_back(pair.truth.translation);
    estimate.push_back(pair.estimate.translation);
  }
  return AlignPoints(truth, estimate, alignment == TrajectoryAlignment::kSim3);
}

}  // namespace s3lam
