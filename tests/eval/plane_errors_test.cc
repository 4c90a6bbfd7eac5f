#include "s3lam/eval/plane_errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <numbers>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr double kDegree = std::numbers::pi / 180.0;

Plane Through(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) {
  return {normal.normalized(), -normal.normalized().dot(point)};
}

KnownPlane Known(const std::string& name, const std::string& label, const Eigen::Vector3d& center,
                 const Eigen::Vector3d& normal) {
  return {name, label, Through(center, normal), center, 1.0};
}

FittedPlane Fitted(uint32_t id, const std::string& label, const Eigen::Vector3d& center,
                   const Eigen::Vector3d& normal) {
  return {PlaneId(id), label, Through(center, normal), center, 100};
}

/// Floor, a table top above it, and a wall.
std::vector<KnownPlane> Room() {
  return {Known("floor", "floor", {0, 0, 0}, {0, 0, 1}),
          Known("top", "table", {0, 0, 1}, {0, 0, 1}), Known("wall", "wall", {3, 0, 1}, {1, 0, 0})};
}

TEST(PlaneErrors, OfKnownTilts) {
  const std::vector<FittedPlane> fitted = {
      Fitted(4, "wall", {3.1, 0, 1}, {1, 0, 0}),
      Fitted(7, "floor", {0, 0, 0}, {std::sin(2 * kDegree), 0, std::cos(2 * kDegree)}),
      Fitted(9, "table", {0.5, 0, 1.02}, {0, 0, -1})};
  const PlaneErrors errors = ComparePlanes(Room(), fitted, Similarity3());
  EXPECT_EQ(errors.num_found, 3u);
  EXPECT_EQ(errors.matches[0].fitted.value().id, PlaneId(7));
  EXPECT_NEAR(errors.matches[0].normal_deg, 2.0, 1e-9);
  EXPECT_NEAR(errors.matches[0].offset, 0.0, 1e-12);
  EXPECT_NEAR(errors.matches[1].normal_deg, 0.0, 1e-9);
  EXPECT_NEAR(errors.matches[1].offset, 0.02, 1e-12);
  EXPECT_NEAR(errors.matches[2].offset, 0.1, 1e-12);
  // Floor and top are 2 deg from parallel, floor and wall 2 deg from orthogonal, top and wall 0.
  EXPECT_EQ(errors.parallel_deg.count, 1u);
  EXPECT_NEAR(errors.parallel_deg.max, 2.0, 1e-9);
  EXPECT_EQ(errors.orthogonal_deg.count, 2u);
  EXPECT_NEAR(errors.orthogonal_deg.mean, 1.0, 1e-9);
  EXPECT_EQ(errors.all_pairs_deg.count, 3u);
}

TEST(PlaneErrors, AreMeasuredInTheWorldOfTheTruth) {
  const Similarity3 truth_from_estimate{
      2.0, QuaternionFromRotationVector({0.3, 1.0, -0.5}), {1.0, 2.0, 3.0}};
  const Similarity3 back = truth_from_estimate.Inverse();
  std::vector<FittedPlane> fitted = {Fitted(0, "table", {0, 0, 1.05}, {0, 0, 1})};
  fitted[0].plane = TransformPlane(back, fitted[0].plane);
  fitted[0].centroid = back * fitted[0].centroid;
  const PlaneErrors errors = ComparePlanes(Room(), fitted, truth_from_estimate);
  ASSERT_TRUE(errors.matches[1].fitted.has_value());
  EXPECT_NEAR(errors.matches[1].offset, 0.05, 1e-12);
  EXPECT_NEAR(errors.matches[1].normal_deg, 0.0, 1e-6);
  EXPECT_EQ(errors.num_found, 1u);
}

TEST(PlaneErrors, OtherPlanesAreNotTaken) {
  const std::vector<FittedPlane> fitted = {
      Fitted(0, "floor", {0, 0, 1}, {0, 0, 1}),                     // The table's place.
      Fitted(1, "table", {5, 0, 1}, {0, 0, 1}),                     // Beside the table.
      Fitted(2, "wall", {3, 0, 1}, {1, std::tan(25 * kDegree), 0})  // Turned too far.
  };
  EXPECT_EQ(ComparePlanes(Room(), fitted, Similarity3()).num_found, 0u);
}

TEST(PlaneErrors, EachPlaneServesOnceAndTheNearestWins) {
  const std::vector<KnownPlane> known = {Known("a", "book", {0, 0, 0.00}, {0, 0, 1}),
                                         Known("b", "book", {0, 0, 0.10}, {0, 0, 1})};
  const std::vector<FittedPlane> one = {Fitted(0, "book", {0, 0, 0.08}, {0, 0, 1})};
  const PlaneErrors errors = ComparePlanes(known, one, Similarity3());
  EXPECT_FALSE(errors.matches[0].fitted.has_value());
  ASSERT_TRUE(errors.matches[1].fitted.has_value());
  EXPECT_NEAR(errors.matches[1].offset, 0.02, 1e-12);
  EXPECT_THAT(ToTable(errors), HasSubstr("1 of 2 found"));
  const json report = ToJson(errors);
  EXPECT_TRUE(report["planes"][0]["plane"].is_null());
  EXPECT_EQ(report["planes"][1]["plane"], 0);
}

json KnownJson() {
  return {{"objects",
           {{{"name", "top"},
             {"category_id", 67},
             {"plane_gt", {{"n", {0, 0, 1}}, {"d", -1.0}}},
             {"centroid_gt", {0, 0, 1.01}},
             {"polygon_gt", {{1, 0, 1}, {0, 2, 1}, {-1, 0, 1}}}},
            {{"name", "cup"}, {"category_id", 47}, {"planar", false}},
            {{"name", "narrow"}, {"plane_reliable", false}, {"plane_gt", {{"n", {0, 0, 1}}}}}}}};
}

TEST(KnownPlanes, AreReadFromObjects) {
  const auto planes = KnownPlanesFromJson(KnownJson(), "gt", {{67, "dining table"}}, "f.json");
  ASSERT_EQ(planes.size(), 1u);
  EXPECT_EQ(planes[0].name, "top");
  EXPECT_EQ(planes[0].label, "dining table");
  EXPECT_EQ(planes[0].centroid_in_truth.z(), 1.0);  // Moved onto the plane.
  EXPECT_DOUBLE_EQ(planes[0].radius, 2.0);
  EXPECT_EQ(KnownPlanesFromJson(KnownJson(), "gt", {}, "f.json")[0].label, "");
}

TEST(KnownPlanes, BadFilesAreRefusedByName) {
  const auto read = [](const json& document, const std::string& frame) {
    return [=] { KnownPlanesFromJson(document, frame, {{67, "table"}}, "f.json"); };
  };
  EXPECT_THAT(read(json::object(), "gt"), ThrowsMessage<InputError>(HasSubstr("f.json: no list")));
  EXPECT_THAT(read(KnownJson(), "sfm"), ThrowsMessage<InputError>(HasSubstr("plane_sfm")));
  json bad = KnownJson();
  bad["objects"][0]["plane_gt"]["n"] = {0, 0, 2};
  EXPECT_THAT(read(bad, "gt"),
              ThrowsMessage<InputError>(HasSubstr("f.json: objects[0]: the normal")));
  bad["objects"][0]["plane_gt"]["n"] = {0, 0};
  EXPECT_THAT(read(bad, "gt"), ThrowsMessage<InputError>(HasSubstr("f.json: objects[0]")));
  bad = KnownJson();
  bad["objects"][0]["category_id"] = 5;
  EXPECT_THAT(read(bad, "gt"), ThrowsMessage<InputError>(HasSubstr("class table")));
}

TEST(FittedPlanes, AreReadFromBothFiles) {
  json plane = {{"id", 3},
                {"class", "wall"},
                {"normal_in_world", {0, 1, 0}},
                {"offset", 0.5},
                {"centroid_in_world", {1, -0.5, 0}},
                {"inliers", {4, 8, 9}}};
  EXPECT_EQ(FittedPlanesFromJson({{"planes", {plane}}}, "s.json")[0].num_points, 3u);
  plane.erase("inliers");
  plane["points"] = 70;
  const auto planes = FittedPlanesFromJson({{"planes", {plane}}}, "p.json");
  EXPECT_EQ(planes[0].num_points, 70u);
  EXPECT_EQ(planes[0].plane.offset, 0.5);
  plane.erase("offset");
  EXPECT_THAT(
      [&] {
        FittedPlanesFromJson({{"planes", {plane}}}, "p.json");
      },
      ThrowsMessage<InputError>(HasSubstr("p.json: planes[0]")));
}

}  // namespace
}  // namespace s3lam
