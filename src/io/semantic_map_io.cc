#include "s3lam/io/semantic_map_io.h"

#include <nlohmann/json.hpp>
#include <ostream>

#include "class_table_json.h"
#include "json_fields.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"
#include "s3lam/io/npy.h"

namespace s3lam {
namespace {

using nlohmann::json;

constexpr const char* kFormat = "s3lam-semantics";
constexpr int kVersion = 1;
constexpr int kPlanesVersion = 1;  // Of planes.json.
constexpr const char* kMapFile = "semantics.json";
constexpr const char* kDistributionFile = "distributions.npy";

template <int Rows>
json VectorToJson(const Eigen::Matrix<double, Rows, 1>& vector) {
  return std::vector<double>(vector.data(), vector.data() + Rows);
}

json PointsToJson(const std::vector<PointId>& points) {
  json list = json::array();
  for (const PointId id : points) list.push_back(id.value());
  return list;
}

json ClusterToJson(const Cluster& cluster, const ClassTable& table) {
  const SemanticClass& c = table.classes.at(static_cast<size_t>(cluster.class_index));
  json segments = json::array();
  for (const SegmentRef& ref : cluster.segments) {
    segments.push_back({ref.image_id.value(), ref.segment_id});
  }
  return {{"id", cluster.id.value()},
          {"class_id", c.id},
          {"class", c.name},
          {"centroid_in_world", VectorToJson<3>(cluster.centroid_in_world)},
          {"points", PointsToJson(cluster.points)},
          {"segments", std::move(segments)}};
}

json PlaneToJson(const PlanarSurface& plane, const ClassTable& table) {
  const SemanticClass& c = table.classes.at(static_cast<size_t>(plane.class_index));
  json extent = json::array();
  for (const Eigen::Vector2d& corner : plane.extent) extent.push_back(VectorToJson<2>(corner));
  json covariance = json::array();
  for (int i = 0; i < 3; ++i) {
    covariance.push_back(VectorToJson<3>(plane.covariance.row(i).transpose()));
  }
  return {{"id", plane.id.value()},
          {"cluster_id", plane.cluster_id.value()},
          {"class_id", c.id},
          {"class", c.name},
          {"normal_in_world", VectorToJson<3>(plane.plane_in_world.normal)},
          {"offset", plane.plane_in_world.offset},
          {"centroid_in_world", VectorToJson<3>(plane.centroid_in_world)},
          {"axis_u_in_world", VectorToJson<3>(plane.axis_u_in_world)},
          {"axis_v_in_world", VectorToJson<3>(plane.axis_v_in_world)},
          {"extent_uv", std::move(extent)},
          {"rms", plane.rms},
          {"rms_sigma", plane.rms_sigma},
          {"covariance", std::move(covariance)},
          {"inliers", PointsToJson(plane.inliers)}};
}

/// One line per entry: readable, and an editor can still open it.
void WriteEntries(const char* key, const std::vector<json>& entries, const char* tail,
                  std::ostream& stream) {
  stream << "\"" << key << "\": [";
  for (size_t i = 0; i < entries.size(); ++i) {
    stream << (i == 0 ? "\n  " : ",\n  ") << entries[i].dump();
  }
  stream << (entries.empty() ? "]" : "\n]") << tail;
}

void WriteMapJson(const SemanticMap& map, std::ostream& stream) {
  json clusters_of_points = json::array();
  for (const ClusterId id : map.cluster_of_point) {
    clusters_of_points.push_back(id.valid() ? json(id.value()) : json(nullptr));
  }
  const json table = ClassTableToJson(map.class_table);
  std::vector<json> clusters;
  for (const auto& [id, cluster] : map.clusters) {
    clusters.push_back(ClusterToJson(cluster, map.class_table));
  }
  std::vector<json> planes;
  for (const auto& [id, plane] : map.planes) planes.push_back(PlaneToJson(plane, map.class_table));
  stream << "{\n\"format\": \"" << kFormat << "\",\n\"version\": " << kVersion
         << ",\n\"model_fingerprint\": " << json(map.model_fingerprint).dump()
         << ",\n\"class_table\": {\"name\": " << table["name"].dump() << ",\n";
  WriteEntries("classes", table["classes"].get<std::vector<json>>(), "},\n", stream);
  WriteEntries("clusters", clusters, ",\n", stream);
  WriteEntries("planes", planes, ",\n", stream);
  stream << "\"points\": " << PointsToJson(map.points).dump()
         << ",\n\"num_mask_observations\": " << json(map.num_mask_observations).dump()
         << ",\n\"cluster_of_point\": " << clusters_of_points.dump() << "\n}\n";
}

std::vector<PointId> ParsePoints(const JsonFields& fields, const char* key) {
  std::vector<PointId> points;
  for (const json& value : fields.List(key)) {
    points.emplace_back(fields.AsInteger<uint64_t>(value, key));
    if (points.size() > 1 && points[points.size() - 2] >= points.back()) {
      ThrowInputError("{}: '{}' is not in ascending order", fields.where(), key);
    }
  }
  return points;
}

int ParseClassIndex(const JsonFields& fields, const ClassTable& table) {
  const int class_id = fields.Int("class_id");
  const std::optional<int> index = table.IndexOfId(class_id);
  if (!index) ThrowInputError("{}: class {} is not in the class table", fields.where(), class_id);
  return *index;
}

Cluster ParseCluster(const json& object, const ClassTable& table, const std::string& where) {
  const JsonFields fields(object, where);
  Cluster cluster;
  cluster.id = ClusterId(fields.Int<uint32_t>("id"));
  cluster.class_index = ParseClassIndex(fields, table);
  cluster.centroid_in_world = fields.Vector<3>("centroid_in_world");
  cluster.points = ParsePoints(fields, "points");
  for (const json& pair : fields.List("segments")) {
    if (!pair.is_array() || pair.size() != 2) {
      ThrowInputError("{}: 'segments' needs pairs of image and segment", where);
    }
    cluster.segments.push_back({ImageId(fields.AsInteger<uint32_t>(pair[0], "segments")),
                                fields.AsInteger<uint32_t>(pair[1], "segments")});
  }
  return cluster;
}

/// What semantics.json and planes.json tell of a plane alike: all but class and covariance.
PlanarSurface ParseSurface(const JsonFields& fields) {
  PlanarSurface plane;
  plane.id = PlaneId(fields.Int<uint32_t>("id"));
  plane.cluster_id = ClusterId(fields.Int<uint32_t>("cluster_id"));
  plane.plane_in_world.normal = fields.Vector<3>("normal_in_world");
  if (std::abs(plane.plane_in_world.normal.norm() - 1.0) > 1e-6) {
    ThrowInputError("{}: 'normal_in_world' is not a unit vector", fields.where());
  }
  plane.plane_in_world.offset = fields.Number("offset");
  plane.centroid_in_world = fields.Vector<3>("centroid_in_world");
  plane.axis_u_in_world = fields.Vector<3>("axis_u_in_world");
  plane.axis_v_in_world = fields.Vector<3>("axis_v_in_world");
  for (const json& corner : fields.List("extent_uv")) {
    plane.extent.emplace_back(fields.AsVector<2>(corner, "extent_uv"));
  }
  plane.rms = fields.Number("rms");
  plane.rms_sigma = fields.Number("rms_sigma");
  plane.inliers = ParsePoints(fields, "inliers");
  return plane;
}

PlanarSurface ParsePlane(const json& object, const ClassTable& table, const std::string& where) {
  const JsonFields fields(object, where);
  PlanarSurface plane = ParseSurface(fields);
  plane.class_index = ParseClassIndex(fields, table);
  const json& covariance = fields.List("covariance");
  if (covariance.size() != 3) ThrowInputError("{}: 'covariance' needs three rows", where);
  for (int i = 0; i < 3; ++i) {
    plane.covariance.row(i) =
        fields.AsVector<3>(covariance[static_cast<size_t>(i)], "covariance").transpose();
  }
  return plane;
}

void ParsePointTables(const JsonFields& fields, SemanticMap& map) {
  map.points = ParsePoints(fields, "points");
  for (const json& value : fields.List("num_mask_observations")) {
    map.num_mask_observations.push_back(fields.AsInteger<int>(value, "num_mask_observations"));
  }
  for (const json& value : fields.List("cluster_of_point")) {
    map.cluster_of_point.push_back(
        value.is_null() ? kInvalidClusterId
                        : ClusterId(fields.AsInteger<uint32_t>(value, "cluster_of_point")));
  }
  if (map.num_mask_observations.size() != map.points.size() ||
      map.cluster_of_point.size() != map.points.size()) {
    ThrowInputError("{}: 'points', 'num_mask_observations' and 'cluster_of_point' differ in length",
                    fields.where());
  }
}

void ParseClustersAndPlanes(const JsonFields& fields, SemanticMap& map) {
  const json& clusters = fields.List("clusters");
  for (size_t i = 0; i < clusters.size(); ++i) {
    const std::string where = fmt::format("{}: clusters[{}]", fields.where(), i);
    Cluster cluster = ParseCluster(clusters[i], map.class_table, where);
    if (!map.clusters.emplace(cluster.id, cluster).second) {
      ThrowInputError("{}: id {} is there twice", where, cluster.id.value());
    }
  }
  const json& planes = fields.List("planes");
  for (size_t i = 0; i < planes.size(); ++i) {
    const std::string where = fmt::format("{}: planes[{}]", fields.where(), i);
    PlanarSurface plane = ParsePlane(planes[i], map.class_table, where);
    if (!map.clusters.contains(plane.cluster_id)) {
      ThrowInputError("{}: cluster {} does not exist", where, plane.cluster_id.value());
    }
    if (!map.planes.emplace(plane.id, plane).second) {
      ThrowInputError("{}: id {} is there twice", where, plane.id.value());
    }
  }
  for (const ClusterId id : map.cluster_of_point) {
    if (id.valid() && !map.clusters.contains(id)) {
      ThrowInputError("{}: 'cluster_of_point' names cluster {}, which does not exist",
                      fields.where(), id.value());
    }
  }
}

}  // namespace

void WriteSemanticMap(const SemanticMap& map, const std::filesystem::path& directory) {
  WriteFile(directory / kMapFile, [&](std::ostream& stream) { WriteMapJson(map, stream); });
  WriteNpy(map.distributions, directory / kDistributionFile);
}

SemanticMap ReadSemanticMap(const std::filesystem::path& directory) {
  const std::filesystem::path path = directory / kMapFile;
  const json document = ReadJson(path);
  const JsonFields fields(document, path.string());
  if (fields.String("format") != kFormat) {
    ThrowInputError("{}: 'format' is not '{}'", path.string(), kFormat);
  }
  if (const int version = fields.Int("version"); version != kVersion) {
    ThrowInputError("{}: version {} is not known here (only {}); write it anew with s3-lift",
                    path.string(), version, kVersion);
  }
  SemanticMap map;
  map.model_fingerprint = fields.String("model_fingerprint");
  map.class_table = ClassTableFromJson(fields.At("class_table"), path.string() + ": class_table");
  ParsePointTables(fields, map);
  ParseClustersAndPlanes(fields, map);
  map.distributions = ReadNpy(directory / kDistributionFile);
  const auto rows = static_cast<Eigen::Index>(map.points.size());
  if (map.distributions.rows() != rows || map.distributions.cols() != map.class_table.size()) {
    ThrowInputError("{}: shape ({}, {}) where {} points and {} classes are due",
                    (directory / kDistributionFile).string(), map.distributions.rows(),
                    map.distributions.cols(), rows, map.class_table.size());
  }
  return map;
}

std::vector<PlanarSurface> ReadRefinedPlanes(const std::filesystem::path& path,
                                             const SemanticMap& semantics) {
  const json document = ReadJson(path);
  const JsonFields fields(document, path.string());
  if (fields.Has("version") && fields.At("version") != kPlanesVersion) {
    ThrowInputError("{}: version {} is not known here (only {}); write it anew with s3-refine",
                    path.string(), fields.At("version").dump(), kPlanesVersion);
  }
  std::vector<PlanarSurface> planes;
  for (const json& entry : fields.List("planes")) {
    const JsonFields of_plane(entry, fmt::format("{}: planes[{}]", path.string(), planes.size()));
    PlanarSurface plane = ParseSurface(of_plane);
    const auto cluster = semantics.clusters.find(plane.cluster_id);
    if (cluster == semantics.clusters.end()) {
      ThrowInputError("{}: the semantic map has no cluster {}", of_plane.where(),
                      plane.cluster_id.value());
    }
    plane.class_index = cluster->second.class_index;
    planes.push_back(std::move(plane));
  }
  return planes;
}

void WritePlanesPly(const SemanticMap& map, const std::filesystem::path& path) {
  std::string vertices;
  std::string faces;
  size_t num_vertices = 0;
  size_t num_faces = 0;
  for (const auto& [id, plane] : map.planes) {
    if (plane.extent.size() < 3) continue;
    const Rgb& color = map.class_table.classes.at(static_cast<size_t>(plane.class_index)).color;
    const Eigen::Vector3d& n = plane.plane_in_world.normal;
    faces += fmt::format("{}", plane.extent.size());
    for (const Eigen::Vector2d& corner : plane.extent) {
      const Eigen::Vector3d x = plane.centroid_in_world + corner.x() * plane.axis_u_in_world +
                                corner.y() * plane.axis_v_in_world;
      vertices += fmt::format("{} {} {} {} {} {} {} {} {} {}\n", x.x(), x.y(), x.z(), n.x(), n.y(),
                              n.z(), color[0], color[1], color[2], id.value());
      faces += fmt::format(" {}", num_vertices++);
    }
    faces += '\n';
    ++num_faces;
  }
  WriteFile(path, [&](std::ostream& stream) {
    stream << "ply\nformat ascii 1.0\nelement vertex " << num_vertices
           << "\nproperty double x\nproperty double y\nproperty double z\n"
              "property double nx\nproperty double ny\nproperty double nz\n"
              "property uchar red\nproperty uchar green\nproperty uchar blue\n"
              "property uint plane_id\nelement face "
           << num_faces << "\nproperty list uint uint vertex_indices\nend_header\n"
           << vertices << faces;
  });
}

}  // namespace s3lam
