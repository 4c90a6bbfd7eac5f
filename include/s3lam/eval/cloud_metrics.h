#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "s3lam/eval/plane_errors.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// How flat the points of one labelled plane lie, about the plane that fits them best (least
/// squares over all of them, whatever plane the map gives them). Lengths are in the truth's unit
/// when the map was aligned, else in map units.
struct PlaneCloud {
  FittedPlane best;        // In the model's own world.
  size_t num_missing = 0;  // Points of the plane that the model does not have (any more).
  double rms = 0.0;        // Of the distances from the plane.
  double median = 0.0;     // Of their magnitudes: what stray points do not move.
  double thickness = 0.0;  // Between the 5th and the 95th percentile of the signed distances.
  double extent = 0.0;     // Standard deviation along the longest direction.
};

/// The planes of `map` with the points of `model`, in ascending id; planes of which fewer than four
/// points are left are left out. The model may be a later one than the map was made from.
std::vector<PlaneCloud> MeasurePlaneClouds(const Reconstruction& model, const SemanticMap& map,
                                           double truth_units_per_unit = 1.0);

/// The planes that fit best, to be held against known ones.
std::vector<FittedPlane> BestPlanes(const std::vector<PlaneCloud>& clouds);

nlohmann::json ToJson(const std::vector<PlaneCloud>& clouds);
std::string ToTable(const std::vector<PlaneCloud>& clouds);

}  // namespace s3lam
