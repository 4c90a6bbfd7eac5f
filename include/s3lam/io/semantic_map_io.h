#pragma once

#include <filesystem>
#include <vector>

#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// Class tables: configs/classes/*.json. Throws InputError naming the file and the entry.
ClassTable ReadClassTable(const std::filesystem::path& path);

/// A semantics folder: semantics.json (version, class table, clusters, planes, model fingerprint)
/// and distributions.npy (points x classes; row order = "points" of semantics.json).
void WriteSemanticMap(const SemanticMap& map, const std::filesystem::path& directory);

/// Throws InputError naming the file and the reason; checks references within the map, but not
/// against a model (CheckSemanticMap does).
SemanticMap ReadSemanticMap(const std::filesystem::path& directory);

/// planes.json of s3-refine. Refinement may divide planes, so that there are some the semantic map
/// does not know; their clusters it has to know. Throws InputError naming the file and the entry.
std::vector<PlanarSurface> ReadRefinedPlanes(const std::filesystem::path& path,
                                             const SemanticMap& semantics);

/// planes.ply: each plane's extent as a coloured polygon with its normal.
void WritePlanesPly(const SemanticMap& map, const std::filesystem::path& path);

/// points.ply (binary): every point of the model in the colour of its class, with
///   class_id, cluster, plane     -1 for none
///   instance                     number of the object within its class, from 1; 0 for stuff
///   plane_distance               signed, to its plane [map units]; NaN without one
///   probability, margin, entropy of the best class, its lead over the second, in bits
///   observations                 masks it was seen in
///   dynamic                      1 if its class may move
void WritePointsPly(const SemanticMap& map, const Reconstruction& reconstruction,
                    const std::filesystem::path& path);

}  // namespace s3lam
