#include "s3lam/eval/plane_angles.h"

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

/// A normal at this angle from z, in the x-z plane.
Eigen::Vector3d Tilted(double degrees) {
  const double angle = degrees * std::numbers::pi / 180.0;
  return {std::sin(angle), 0.0, std::cos(angle)};
}

std::vector<LabelledNormal> SomePlanes() {
  return {{PlaneId(1), "table", Tilted(0.0)},
          {PlaneId(2), "table", -Tilted(2.0)},
          {PlaneId(4), "wall", Tilted(89.0)},
          {PlaneId(7), "floor", Tilted(5.0)}};
}

TEST(PlaneAngles, AreMeasuredPairwise) {
  const auto pairs = PairwisePlaneAngles(SomePlanes());
  ASSERT_EQ(pairs.size(), 6u);
  EXPECT_EQ(pairs[0].a, PlaneId(1));
  EXPECT_EQ(pairs[0].b, PlaneId(2));
  EXPECT_NEAR(pairs[0].angle_deg, 2.0, 1e-9);
  EXPECT_NEAR(pairs[1].angle_deg, 89.0, 1e-9);
  const PlaneAngleSummary summary = SummarizePlaneAngles(pairs);
  EXPECT_EQ(summary.from_parallel.count, 3u);
  EXPECT_NEAR(summary.from_parallel.min_deg, 2.0, 1e-9);
  EXPECT_NEAR(summary.from_parallel.median_deg, 3.0, 1e-9);
  EXPECT_NEAR(summary.from_parallel.max_deg, 5.0, 1e-9);
  EXPECT_EQ(summary.from_orthogonal.count, 3u);
  EXPECT_NEAR(summary.from_orthogonal.max_deg, 6.0, 1e-9);
}

TEST(PlaneAngles, OfChosenClasses) {
  const std::vector<std::string> labels = {"table", "floor"};
  const auto pairs = PairwisePlaneAngles(SomePlanes(), labels);
  EXPECT_EQ(pairs.size(), 3u);
  EXPECT_EQ(SummarizePlaneAngles(pairs).from_orthogonal.count, 0u);
  EXPECT_THAT(ToTable(pairs), HasSubstr("7 floor"));
  EXPECT_EQ(ToJson(pairs)["pairs"].size(), 3u);
  EXPECT_EQ(ToJson(pairs)["from_parallel"]["count"], 3);
}

TEST(PlaneAngles, AreReadFromPlaneLists) {
  const json good = json::parse(R"({"planes": [
      {"id": 3, "class": "wall", "normal_in_world": [0, 0.6, 0.8], "offset": 1}]})");
  const auto planes = LabelledNormalsFromJson(good, "planes.json");
  ASSERT_EQ(planes.size(), 1u);
  EXPECT_EQ(planes[0].id, PlaneId(3));
  EXPECT_EQ(planes[0].label, "wall");
  EXPECT_NEAR(planes[0].normal.z(), 0.8, 1e-15);
  for (const char* text :
       {"[]", R"({"planes": 3})", R"({"planes": [{}]})", R"({"planes": [3]})",
        R"({"planes": [{"id": 3, "class": "wall", "normal_in_world": [0, 1]}]})",
        R"({"planes": [{"id": 3, "class": "wall", "normal_in_world": [0, 0, 2]}]})",
        R"({"planes": [{"id": 3, "class": 1, "normal_in_world": [0, 0, 1]}]})"}) {
    EXPECT_THAT([&] { LabelledNormalsFromJson(json::parse(text), "planes.json"); },
                ThrowsMessage<InputError>(HasSubstr("planes.json")))
        << text;
  }
}

}  // namespace
}  // namespace s3lam
