#include "s3lam/scene/semantic_map.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "s3lam/base/error.h"

namespace s3lam {

std::optional<int> ClassTable::IndexOfId(int class_id) const {
  const auto it = std::lower_bound(classes.begin(), classes.end(), class_id,
                                   [](const SemanticClass& c, int id) { return c.id < id; });
  if (it == classes.end() || it->id != class_id) return std::nullopt;
  return static_cast<int>(it - classes.begin());
}

namespace {

void CheckPointsExist(const std::vector<PointId>& points, const Reconstruction& reconstruction,
                      const std::string& source, const std::string& owner) {
  for (const PointId id : points) {
    if (!reconstruction.points.contains(id)) {
      ThrowInputError("{}: {} refers to point {}, which the model does not have", source, owner,
                      id.value());
    }
  }
}

}  // namespace

void CheckSemanticMap(const SemanticMap& map, const Reconstruction& reconstruction,
                      const std::string& source) {
  const size_t rows = map.points.size();
  if (static_cast<size_t>(map.distributions.rows()) != rows ||
      map.num_mask_observations.size() != rows || map.cluster_of_point.size() != rows ||
      (rows > 0 && map.distributions.cols() != map.class_table.size())) {
    ThrowInputError("{}: tables per point differ in size", source);
  }
  CheckPointsExist(map.points, reconstruction, source, "the point list");
  for (const auto& [id, cluster] : map.clusters) {
    if (cluster.class_index < 0 || cluster.class_index >= map.class_table.size()) {
      ThrowInputError("{}: cluster {} has no class", source, id.value());
    }
    CheckPointsExist(cluster.points, reconstruction, source, fmt::format("cluster {}", id.value()));
  }
  for (const auto& [id, plane] : map.planes) {
    const Plane& p = plane.plane_in_world;
    if (!p.normal.allFinite() || !std::isfinite(p.offset) ||
        std::abs(p.normal.norm() - 1.0) > 1e-6) {
      ThrowInputError("{}: plane {} has a normal that is not a finite unit vector", source,
                      id.value());
    }
    if (!map.clusters.contains(plane.cluster_id)) {
      ThrowInputError("{}: plane {} belongs to cluster {}, which does not exist", source,
                      id.value(), plane.cluster_id.value());
    }
    CheckPointsExist(plane.inliers, reconstruction, source, fmt::format("plane {}", id.value()));
  }
}

std::string FingerprintOfModel(const Reconstruction& reconstruction) {
  uint64_t hash = 0xcbf29ce484222325ULL;  // FNV-1a over 64-bit words.
  const auto add = [&hash](uint64_t word) { hash = (hash ^ word) * 0x100000001b3ULL; };
  const auto add_real = [&add](double x) { add(std::bit_cast<uint64_t>(x)); };
  for (const auto& [id, image] : reconstruction.images) {
    add(id.value());
    for (const double x : image.cam_from_world.translation) add_real(x);
  }
  for (const auto& [id, point] : reconstruction.points) {
    add(id.value());
    for (const double x : point.xyz) add_real(x);
  }
  return fmt::format("{}-{}-{:016x}", reconstruction.images.size(), reconstruction.points.size(),
                     hash);
}

void CheckMadeFromModel(const SemanticMap& map, const std::string& fingerprint,
                        const std::string& source) {
  if (map.model_fingerprint == fingerprint) return;
  ThrowInputError(
      "{}: made from another model (its fingerprint is {}, the model's {}): run s3-lift on this "
      "one",
      source, map.model_fingerprint, fingerprint);
}

}  // namespace s3lam
