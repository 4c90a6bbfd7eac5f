#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/eval/trajectory_error.h"
#include "s3lam/scene/reconstruction.h"

namespace s3lam {

/// How two models of the same images differ, after the first was aligned to the second. Lengths are
/// in the second model's unit.
struct ModelDifference {
  size_t num_images = 0;
  size_t num_other_images = 0;
  std::vector<std::string> names;  // Of the images both have, ascending.
  Similarity3 other_from_model;
  std::vector<PoseError> poses;  // Per name; the time is its place in `names`.
  ErrorStatistics center;        // Distance of the camera centres.
  ErrorStatistics rotation_deg;
  ErrorStatistics focal_percent;  // Per image: first focal length, relative to the other's.
  /// Distance of points with the same id, as a refined model keeps them; nothing without such.
  ErrorStatistics points;
};

/// Images are the same if their names are. Empty if fewer than three are, or (with alignment) their
/// centres leave the rotation undetermined.
std::optional<ModelDifference> CompareModels(
    const Reconstruction& model, const Reconstruction& other,
    TrajectoryAlignment align = TrajectoryAlignment::kSim3);

nlohmann::json ToJson(const ModelDifference& difference);
std::string ToTable(const ModelDifference& difference);

}  // namespace s3lam
