#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <ostream>

#include "s3lam/io/file.h"
#include "s3lam/io/semantic_map_io.h"

namespace s3lam {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are written as they lie");

constexpr Rgb kUnlabelled = {90, 90, 90};
constexpr const char* kProperties =
    "property double x\nproperty double y\nproperty double z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    "property int class_id\nproperty int instance\nproperty int cluster\nproperty int plane\n"
    "property float plane_distance\nproperty float probability\nproperty float margin\n"
    "property float entropy\nproperty int observations\nproperty uchar dynamic\n";

/// What is known of a point besides its place.
struct PointLabels {
  Rgb color = kUnlabelled;
  int32_t class_id = -1;
  int32_t instance = 0;
  int32_t cluster = -1;
  int32_t plane = -1;
  float plane_distance = std::numeric_limits<float>::quiet_NaN();
  float probability = 0.0F;
  float margin = 0.0F;
  float entropy = 0.0F;
  int32_t observations = 0;
  uint8_t dynamic = 0;
};

template <typename T>
void Put(const T& value, std::ostream& stream) {
  stream.write(reinterpret_cast<const char*>(&value), sizeof(T));
}

/// Best class, and how certain it is.
int ReadCertainty(const SemanticMap& map, Eigen::Index row, PointLabels& labels) {
  int best = 0;
  labels.probability = map.distributions.row(row).maxCoeff(&best);
  float second = 0.0F;
  for (Eigen::Index c = 0; c < map.distributions.cols(); ++c) {
    const float p = map.distributions(row, c);
    if (c != best) second = std::max(second, p);
    if (p > 0.0F) labels.entropy -= p * std::log2(p);
  }
  labels.margin = labels.probability - second;
  return best;
}

/// Objects counted within their classes, from 1; 0 for stuff.
std::map<ClusterId, int32_t> NumberInstances(const SemanticMap& map) {
  std::map<ClusterId, int32_t> instance_of;
  std::map<int, int32_t> count;
  for (const auto& [id, cluster] : map.clusters) {
    const bool is_thing =
        map.class_table.classes[static_cast<size_t>(cluster.class_index)].is_thing;
    instance_of[id] = is_thing ? ++count[cluster.class_index] : 0;
  }
  return instance_of;
}

std::map<PointId, PointLabels> LabelPoints(const SemanticMap& map,
                                           const Reconstruction& reconstruction) {
  const std::map<ClusterId, int32_t> instance_of = NumberInstances(map);
  std::map<PointId, PointLabels> result;
  for (size_t row = 0; row < map.points.size(); ++row) {
    PointLabels& labels = result[map.points[row]];
    int class_index = ReadCertainty(map, static_cast<Eigen::Index>(row), labels);
    if (const ClusterId cluster = map.cluster_of_point[row]; cluster.valid()) {
      class_index = map.clusters.at(cluster).class_index;
      labels.cluster = static_cast<int32_t>(cluster.value());
      labels.instance = instance_of.at(cluster);
    }
    const SemanticClass& c = map.class_table.classes[static_cast<size_t>(class_index)];
    labels.color = c.color;
    labels.class_id = c.id;
    labels.observations = map.num_mask_observations[row];
    labels.dynamic = c.is_dynamic ? 1 : 0;
  }
  for (const auto& [id, plane] : map.planes) {
    for (const PointId point : plane.inliers) {
      PointLabels& labels = result[point];
      labels.plane = static_cast<int32_t>(id.value());
      labels.plane_distance = static_cast<float>(
          plane.plane_in_world.SignedDistance(reconstruction.points.at(point).xyz));
    }
  }
  return result;
}

}  // namespace

void WritePointsPly(const SemanticMap& map, const Reconstruction& reconstruction,
                    const std::filesystem::path& path) {
  const std::map<PointId, PointLabels> labelled = LabelPoints(map, reconstruction);
  WriteFile(path, [&](std::ostream& stream) {
    stream << "ply\nformat binary_little_endian 1.0\nelement vertex "
           << reconstruction.points.size() << "\n"
           << kProperties << "end_header\n";
    for (const auto& [id, point] : reconstruction.points) {
      const auto it = labelled.find(id);
      const PointLabels labels = it == labelled.end() ? PointLabels{} : it->second;
      for (int i = 0; i < 3; ++i) Put(point.xyz[i], stream);
      for (const uint8_t channel : labels.color) Put(channel, stream);
      Put(labels.class_id, stream);
      Put(labels.instance, stream);
      Put(labels.cluster, stream);
      Put(labels.plane, stream);
      Put(labels.plane_distance, stream);
      Put(labels.probability, stream);
      Put(labels.margin, stream);
      Put(labels.entropy, stream);
      Put(labels.observations, stream);
      Put(labels.dynamic, stream);
    }
  });
}

}  // namespace s3lam
