#include "s3lam/io/semantic_map_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>

#include "s3lam/base/error.h"
#include "s3lam/io/file.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using testing::FileBytes;
using ::testing::HasSubstr;
using testing::TempDir;

SemanticMap MakeMap() {
  SemanticMap map;
  map.class_table.name = "test";
  map.class_table.classes.push_back(
      {3, "wall", false, true, false, 40, SurfaceOrientation::kVertical, {9, 8, 7}});
  map.class_table.classes.push_back({8, "cup", true, false, true, 50, {}, {1, 2, 3}});
  map.points = {PointId(2), PointId(5), PointId((1ULL << 60) + 1)};
  map.distributions.resize(3, 2);
  map.distributions << 0.25F, 0.75F, 1.0F / 3.0F, 2.0F / 3.0F, 1.0F, 0.0F;
  map.num_mask_observations = {4, 1, 2};
  map.cluster_of_point = {ClusterId(1), kInvalidClusterId, ClusterId(1)};
  Cluster cluster;
  cluster.id = ClusterId(1);
  cluster.class_index = 0;
  cluster.points = {map.points[0], map.points[2]};
  cluster.centroid_in_world = {0.1, -1.0 / 3.0, 1e-9};
  cluster.segments = {{ImageId(1), 70000}, {ImageId(2), 0}};
  map.clusters[cluster.id] = cluster;
  PlanarSurface plane;
  plane.id = PlaneId(7);
  plane.cluster_id = cluster.id;
  plane.class_index = 0;
  plane.plane_in_world = {Eigen::Vector3d(1, 2, 3).normalized(), -0.123456789012345};
  plane.centroid_in_world = {3, 2, 1};
  plane.extent = {{0, 0}, {1, 0}, {1, 0.1}};
  plane.inliers = cluster.points;
  plane.rms = 0.01;
  plane.rms_sigma = 1.1;
  plane.covariance << 1, 2, 3, 2, 5, 6, 3, 6, 9;
  map.planes[plane.id] = plane;
  map.model_fingerprint = "1-2-\"quoted\"";
  return map;
}

std::string ErrorOfReading(const std::filesystem::path& directory) {
  try {
    (void)ReadSemanticMap(directory);
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

TEST(SemanticMapIo, RoundTrip) {
  const TempDir dir;
  const SemanticMap map = MakeMap();
  WriteSemanticMap(map, dir.path());
  const SemanticMap read = ReadSemanticMap(dir.path());
  EXPECT_EQ(read.model_fingerprint, map.model_fingerprint);
  EXPECT_EQ(read.class_table.name, "test");
  ASSERT_EQ(read.class_table.size(), 2);
  EXPECT_EQ(read.class_table.classes[0].orientation, SurfaceOrientation::kVertical);
  EXPECT_EQ(read.class_table.classes[0].min_plane_inliers, 40);
  EXPECT_TRUE(read.class_table.classes[1].is_dynamic);
  EXPECT_EQ(read.points, map.points);
  EXPECT_EQ(read.distributions, map.distributions);
  EXPECT_EQ(read.num_mask_observations, map.num_mask_observations);
  EXPECT_EQ(read.cluster_of_point, map.cluster_of_point);
  ASSERT_EQ(read.clusters.size(), 1U);
  const Cluster& cluster = read.clusters.at(ClusterId(1));
  EXPECT_EQ(cluster.points, map.clusters.at(ClusterId(1)).points);
  EXPECT_EQ(cluster.centroid_in_world, map.clusters.at(ClusterId(1)).centroid_in_world);
  EXPECT_EQ(cluster.segments, map.clusters.at(ClusterId(1)).segments);
  ASSERT_EQ(read.planes.size(), 1U);
  const PlanarSurface& plane = read.planes.at(PlaneId(7));
  const PlanarSurface& expected = map.planes.at(PlaneId(7));
  EXPECT_EQ(plane.plane_in_world.normal, expected.plane_in_world.normal);
  EXPECT_EQ(plane.plane_in_world.offset, expected.plane_in_world.offset);
  EXPECT_EQ(plane.centroid_in_world, expected.centroid_in_world);
  EXPECT_EQ(plane.axis_u_in_world, expected.axis_u_in_world);
  EXPECT_EQ(plane.axis_v_in_world, expected.axis_v_in_world);
  EXPECT_EQ(plane.extent, expected.extent);
  EXPECT_EQ(plane.inliers, expected.inliers);
  EXPECT_EQ(plane.rms, expected.rms);
  EXPECT_EQ(plane.rms_sigma, expected.rms_sigma);
  EXPECT_EQ(plane.covariance, expected.covariance);
}

TEST(SemanticMapIo, PointsPlyHasARecordForEveryPoint) {
  const TempDir dir;
  const SemanticMap map = MakeMap();
  Reconstruction model;
  for (const PointId id : map.points) model.points[id].xyz = {1.0, 2.0, 3.0};
  model.points[PointId(999)];  // Without any label.
  WritePointsPly(map, model, dir / "points.ply");
  const std::string ply = FileBytes(dir / "points.ply");
  EXPECT_THAT(ply, HasSubstr("element vertex " + std::to_string(model.points.size()) + "\n"));
  const std::string end = "end_header\n";
  const size_t begin = ply.find(end) + end.size();
  constexpr size_t kRecord = 3 * 8 + 3 + 4 * 4 + 4 * 4 + 4 + 1;
  ASSERT_EQ(ply.size() - begin, kRecord * model.points.size());
  const auto field = [&](size_t record, size_t offset) {
    int32_t value = 0;
    std::memcpy(&value, ply.data() + begin + record * kRecord + offset, sizeof(value));
    return value;
  };
  // class_id, instance, cluster, plane of the first point, and class_id of the one without any.
  EXPECT_EQ(field(0, 27), 3);
  EXPECT_EQ(field(0, 31), 0);
  EXPECT_EQ(field(0, 35), 1);
  EXPECT_EQ(field(0, 39), 7);
  EXPECT_EQ(field(2, 27), -1);
}

TEST(SemanticMapIo, EmptyMapRoundTrip) {
  const TempDir dir;
  SemanticMap map;
  map.class_table = MakeMap().class_table;
  map.distributions.resize(0, 2);
  WriteSemanticMap(map, dir.path());
  const SemanticMap read = ReadSemanticMap(dir.path());
  EXPECT_TRUE(read.points.empty());
  EXPECT_TRUE(read.clusters.empty());
  EXPECT_TRUE(read.planes.empty());
}

TEST(SemanticMapIo, RefusesEveryTruncation) {
  const TempDir dir;
  WriteSemanticMap(MakeMap(), dir.path());
  const std::string json = FileBytes(dir / "semantics.json");
  for (size_t size = 0; size + 1 < json.size(); ++size) {  // The last byte is a line end.
    dir.Write("semantics.json", json.substr(0, size));
    EXPECT_THAT(ErrorOfReading(dir.path()), HasSubstr("semantics.json")) << size << " bytes";
  }
  dir.Write("semantics.json", json);
  const std::string array = FileBytes(dir / "distributions.npy");
  for (size_t size = 0; size < array.size(); ++size) {
    dir.Write("distributions.npy", array.substr(0, size));
    EXPECT_THAT(ErrorOfReading(dir.path()), HasSubstr("distributions.npy")) << size << " bytes";
  }
}

TEST(SemanticMapIo, NamesWhatIsWrong) {
  const TempDir dir;
  WriteSemanticMap(MakeMap(), dir.path());
  const nlohmann::json sound = ReadJson(dir / "semantics.json");
  const auto error = [&](const std::string& pointer, const nlohmann::json& value) {
    nlohmann::json changed = sound;
    changed[nlohmann::json::json_pointer(pointer)] = value;
    WriteJson(dir / "semantics.json", changed);
    return ErrorOfReading(dir.path());
  };
  EXPECT_EQ(error("/version", 1), "");
  EXPECT_THAT(error("/version", 2), HasSubstr("version 2"));
  EXPECT_THAT(error("/format", "x"), HasSubstr("'format'"));
  EXPECT_THAT(error("/points", {2, 2, 5}), HasSubstr("ascending"));
  EXPECT_THAT(error("/points", {2, 5}), HasSubstr("differ in length"));
  EXPECT_THAT(error("/cluster_of_point/1", 4), HasSubstr("cluster 4, which does not exist"));
  EXPECT_THAT(error("/cluster_of_point/1", -1), HasSubstr("not an integer in range"));
  EXPECT_THAT(error("/clusters/0/class_id", 4), HasSubstr("clusters[0]: class 4"));
  EXPECT_THAT(error("/clusters/0/centroid_in_world", {1, 2}), HasSubstr("needs 3 numbers"));
  EXPECT_THAT(error("/clusters/0/segments/0", {1}), HasSubstr("pairs"));
  EXPECT_THAT(error("/planes/0/cluster_id", 4), HasSubstr("planes[0]: cluster 4"));
  EXPECT_THAT(error("/planes/0/normal_in_world", {1, 1, 0}), HasSubstr("unit vector"));
  EXPECT_THAT(error("/planes/0/offset", nullptr), HasSubstr("'offset' is not a finite number"));
  EXPECT_THAT(error("/planes/0/covariance", {{1, 2, 3}}), HasSubstr("three rows"));
  EXPECT_THAT(error("/class_table/classes/0/id", 8), HasSubstr("class id 8 is there twice"));
}

TEST(SemanticMapIo, WritesPlaneOutlines) {
  const TempDir dir;
  WritePlanesPly(MakeMap(), dir / "planes.ply");
  const std::string ply = FileBytes(dir / "planes.ply");
  EXPECT_THAT(ply, HasSubstr("element vertex 3\n"));
  EXPECT_THAT(ply, HasSubstr("element face 1\n"));
  EXPECT_THAT(ply, HasSubstr("\n4 2.1 1 "));  // centroid + 1 u + 0.1 v
  EXPECT_THAT(ply, HasSubstr(" 9 8 7 7\n"));
  EXPECT_THAT(ply, HasSubstr("\n3 0 1 2\n"));
}

}  // namespace
}  // namespace s3lam
