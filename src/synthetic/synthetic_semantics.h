#pragma once

#include "s3lam/synthetic/scene.h"
#include "s3lam/synthetic/synthetic_map.h"

namespace s3lam::synthetic {

/// Fills everything of `map` that is about objects, from its truth, estimate, object_of_point and
/// on_plane.
void AddSemantics(const Scene& scene, uint64_t seed, const SyntheticMapOptions& options,
                  SyntheticMap& map);

}  // namespace s3lam::synthetic
