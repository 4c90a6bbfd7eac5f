#pragma once

#include <nlohmann/json.hpp>

#include "s3lam/refine/plane_model.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// The semantic map as it is after refinement: planes in use with their members as inliers, and
/// centroid, axes, outline, spread and covariance computed anew; points that `refined` no longer
/// has are gone from clusters and tables.
SemanticMap RefinedSemantics(const SemanticMap& original, const PlaneModel& planes,
                             const BundleMap& map, const Reconstruction& refined,
                             const PlaneSigmaOptions& sigma, double sigma_px);

/// planes.json: list of planes with equation (normal . x + offset = 0), centroid, axes, outline,
/// points and spread.
nlohmann::json PlanesToJson(const SemanticMap& map);

}  // namespace s3lam
