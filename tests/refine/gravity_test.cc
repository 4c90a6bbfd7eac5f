#include "s3lam/refine/gravity.h"

#include <gtest/gtest.h>

#include <numbers>

#include "refine/refine_fixture.h"

namespace s3lam::refine {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;

double AngleTo(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return kDegrees * std::atan2(a.cross(b).norm(), a.dot(b));
}

SyntheticMap MakeRoom() {
  SyntheticMapOptions options;
  options.num_images = 30;
  options.num_points = 2500;
  return MakeSyntheticMap("room", 2, options);
}

/// The room in some other world.
Input Turned(const SyntheticMap& map, const Similarity3& other_from_world) {
  Input input;
  input.model = map.truth;
  input.semantics = map.semantics;
  TransformReconstruction(other_from_world, input.model);
  for (auto& [id, surface] : input.semantics.planes) {
    surface.plane_in_world = TransformPlane(other_from_world, surface.plane_in_world);
    surface.centroid_in_world = other_from_world * surface.centroid_in_world;
    surface.axis_u_in_world = other_from_world.rotation * surface.axis_u_in_world;
    surface.axis_v_in_world = other_from_world.rotation * surface.axis_v_in_world;
  }
  return input;
}

const Similarity3 kOther{0.4, QuaternionFromRotationVector({1.1, -0.7, 0.4}), {3.0, 1.0, -2.0}};

TEST(Gravity, UpIsFoundInAnyWorld) {
  const SyntheticMap map = MakeRoom();
  const Input input = Turned(map, kOther);
  GravityReport report;
  const auto up = FindUp({}, input.semantics, input.model, report);
  ASSERT_TRUE(up.has_value()) << report.reason;
  EXPECT_LT(AngleTo(*up, kOther.rotation * Eigen::Vector3d::UnitZ()), 0.3);
  EXPECT_GT(report.num_planes, 5u);
  EXPECT_LT(report.deviation_deg, 1.0);
}

TEST(Gravity, PlanesOfWrongClassesAreOutvoted) {
  const SyntheticMap map = MakeRoom();
  Input input = Turned(map, kOther);
  // Every fifth plane claims to lie as it does not.
  size_t i = 0;
  for (auto& [id, surface] : input.semantics.planes) {
    if (i++ % 5 == 0) surface.plane_in_world.normal = surface.axis_u_in_world;
  }
  GravityReport report;
  const auto up = FindUp({}, input.semantics, input.model, report);
  ASSERT_TRUE(up.has_value()) << report.reason;
  EXPECT_LT(AngleTo(*up, kOther.rotation * Eigen::Vector3d::UnitZ()), 0.3);
  EXPECT_LT(report.num_agreeing, report.num_planes);
}

TEST(Gravity, UprightPlanesAloneAreEnough) {
  const SyntheticMap map = MakeRoom();
  Input input = Turned(map, kOther);
  const auto& classes = input.semantics.class_table.classes;
  std::erase_if(input.semantics.planes, [&](const auto& entry) {
    return classes[entry.second.class_index].orientation == SurfaceOrientation::kHorizontal;
  });
  GravityReport report;
  const auto up = FindUp({}, input.semantics, input.model, report);
  ASSERT_TRUE(up.has_value()) << report.reason;
  EXPECT_LT(AngleTo(*up, kOther.rotation * Eigen::Vector3d::UnitZ()), 0.5);
}

TEST(Gravity, WithoutEvidenceItSaysSo) {
  const SyntheticMap map = MakeRoom();
  Input input = Turned(map, kOther);
  GravityReport report;
  for (SemanticClass& c : input.semantics.class_table.classes) {
    c.orientation = SurfaceOrientation::kAny;
  }
  EXPECT_FALSE(FindUp({}, input.semantics, input.model, report).has_value());
  EXPECT_NE(report.reason.find("no plane of a horizontal class"), std::string::npos);
  EXPECT_EQ(report.num_planes, 0u);
}

TEST(Gravity, TheOutputIsUprightWithTheFloorAtZero) {
  const SyntheticMap map = MakeRoom();
  const Input input = Turned(map, kOther);
  Output output;
  const Report report = refine::Run(MakeOptions({"gravity.mode=floor"}), input, output);
  ASSERT_TRUE(report.gravity.aligned) << report.gravity.reason;
  ASSERT_TRUE(report.gravity.floor.valid());
  const PlanarSurface& floor = output.semantics.planes.at(report.gravity.floor);
  EXPECT_LT(AngleTo(floor.plane_in_world.normal, Eigen::Vector3d::UnitZ()), 0.5);
  EXPECT_NEAR(floor.centroid_in_world.z(), 0.0, 1e-9);
  EXPECT_NEAR(floor.plane_in_world.SignedDistance(floor.centroid_in_world), 0.0, 1e-6);
  for (const auto& [id, image] : output.model.images) {
    // The height of the camera in the scene, whose floor is at z = 0, in the map's unit.
    const double height = map.truth.images.at(id).cam_from_world.CenterInB().z();
    EXPECT_NEAR(image.cam_from_world.CenterInB().z(), kOther.scale * height,
                0.02 * kOther.scale * height);
  }
  CheckReconstruction(output.model, "output");
  CheckSemanticMap(output.semantics, output.model, "output");
}

TEST(Gravity, OffChangesNothing) {
  const SyntheticMap map = MakeDeskMap();
  Output output;
  const Report report = refine::Run(MakeOptions({}), MakeInput(map), output);
  EXPECT_FALSE(report.gravity.aligned);
  const ImageId first = map.estimate.images.begin()->first;
  EXPECT_EQ(output.model.images.at(first).cam_from_world.translation,
            map.estimate.images.at(first).cam_from_world.translation);
}

}  // namespace
}  // namespace s3lam::refine
