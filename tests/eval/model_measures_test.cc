#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "s3lam/base/rng.h"
#include "s3lam/eval/cloud_metrics.h"
#include "s3lam/eval/model_difference.h"

namespace s3lam {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// Points 0, 1, ... near z = 1, scattered by `sigma`, and a map in which they are one plane.
struct FlatScene {
  Reconstruction model;
  SemanticMap map;
};

FlatScene MakeFlatScene(int size, double sigma) {
  Rng rng(3);
  FlatScene scene;
  scene.map.class_table.classes = {{1, "table"}};
  PlanarSurface surface;
  surface.id = PlaneId(5);
  for (int i = 0; i < size; ++i) {
    const PointId id(static_cast<uint64_t>(i));
    const double x = rng.Gaussian(0.0, 2.0);
    const double y = rng.Gaussian(0.0, 0.5);
    scene.model.points[id].xyz = {x, y, 1.0 + rng.Gaussian(0.0, sigma)};
    surface.inliers.push_back(id);
  }
  scene.map.planes[surface.id] = surface;
  return scene;
}

TEST(CloudMetrics, AreThoseOfTheNoise) {
  FlatScene scene = MakeFlatScene(4000, 0.01);
  const auto clouds = MeasurePlaneClouds(scene.model, scene.map);
  ASSERT_EQ(clouds.size(), 1u);
  EXPECT_EQ(clouds[0].best.label, "table");
  EXPECT_EQ(clouds[0].best.num_points, 4000u);
  // Within four standard errors of the figures of a normal distribution.
  EXPECT_NEAR(clouds[0].rms, 0.01, 0.0005);
  EXPECT_NEAR(clouds[0].median, 0.6745 * 0.01, 0.0006);
  EXPECT_NEAR(clouds[0].thickness, 2 * 1.6449 * 0.01, 0.0025);
  EXPECT_NEAR(clouds[0].extent, 2.0, 0.1);
  EXPECT_NEAR(std::abs(clouds[0].best.plane.offset), 1.0, 0.001);
  // In the truth's unit, and without points that the model has lost.
  for (uint64_t i = 0; i < 100; ++i) scene.model.points.erase(PointId(i));
  const auto scaled = MeasurePlaneClouds(scene.model, scene.map, 10.0);
  EXPECT_EQ(scaled[0].num_missing, 100u);
  EXPECT_NEAR(scaled[0].rms, 0.1, 0.005);
  EXPECT_NEAR(std::abs(BestPlanes(scaled)[0].plane.offset), 1.0, 0.001);
  EXPECT_EQ(ToJson(scaled)["planes"][0]["missing"], 100);
  EXPECT_THAT(ToTable(scaled), HasSubstr("5 table"));
}

TEST(CloudMetrics, TooFewPointsAreNoPlane) {
  const FlatScene scene = MakeFlatScene(3, 0.01);
  EXPECT_TRUE(MeasurePlaneClouds(scene.model, scene.map).empty());
}

Reconstruction MakeModel() {
  Rng rng(7);
  Reconstruction model;
  model.cameras[CameraId(1)] = {CameraId(1), CameraModel::kPinhole, 640, 480, {500, 500, 320, 240}};
  for (uint32_t i = 0; i < 10; ++i) {
    Image image;
    image.id = ImageId(i);
    image.camera_id = CameraId(1);
    image.name = std::to_string(9 - i) + ".png";
    const double x = rng.Gaussian(0.0, 1.0);
    const double y = rng.Gaussian(0.0, 1.0);
    image.cam_from_world = {QuaternionFromRotationVector({0.1 * i, 0.0, 0.2}), {x, y, 0.3 * i}};
    model.images[image.id] = image;
    model.points[PointId(i)].xyz = {y, x, 5.0};
  }
  return model;
}

TEST(ModelDifference, IsZeroUpToTheAlignment) {
  const Reconstruction model = MakeModel();
  Reconstruction other = model;
  const Similarity3 other_from_model{
      3.0, QuaternionFromRotationVector({1.0, 0.2, -0.4}), {5.0, 6.0, 7.0}};
  TransformReconstruction(other_from_model, other);
  const auto difference = CompareModels(model, other);
  ASSERT_TRUE(difference.has_value());
  EXPECT_EQ(difference->names.size(), 10u);
  EXPECT_NEAR(difference->other_from_model.scale, 3.0, 1e-9);
  EXPECT_LT(difference->center.max, 1e-9);
  EXPECT_LT(difference->rotation_deg.max, 1e-6);
  EXPECT_LT(difference->points.max, 1e-9);
  EXPECT_EQ(difference->points.count, 10u);
  const auto raw = CompareModels(model, other, TrajectoryAlignment::kNone);
  ASSERT_TRUE(raw.has_value());
  EXPECT_GT(raw->center.min, 1.0);
}

TEST(ModelDifference, ShowsWhatMoved) {
  const Reconstruction model = MakeModel();
  Reconstruction other = model;
  other.cameras[CameraId(1)].params[0] = 510.0;
  other.images.erase(ImageId(0));  // "9.png"
  Image& moved = other.images[ImageId(4)];
  moved.cam_from_world.translation += Eigen::Vector3d(0.0, 0.0, 0.25);
  const auto difference = CompareModels(model, other, TrajectoryAlignment::kNone);
  ASSERT_TRUE(difference.has_value());
  EXPECT_THAT(difference->names, ElementsAre("0.png", "1.png", "2.png", "3.png", "4.png", "5.png",
                                             "6.png", "7.png", "8.png"));
  EXPECT_NEAR(difference->center.max, 0.25, 1e-12);
  EXPECT_NEAR(difference->center.median, 0.0, 1e-12);
  EXPECT_NEAR(difference->poses[5].difference.norm(), 0.25, 1e-12);
  EXPECT_NEAR(difference->focal_percent.mean, 100.0 * (1.0 - 500.0 / 510.0), 1e-9);
  EXPECT_EQ(ToJson(*difference)["common_images"], 9);
  EXPECT_THAT(ToTable(*difference), HasSubstr("10 and 9, 9 in both"));
}

TEST(ModelDifference, NeedsThreeImagesOfTheSameName) {
  Reconstruction other = MakeModel();
  for (auto& [id, image] : other.images) {
    if (id.value() > 1) image.name += ".other";
  }
  EXPECT_FALSE(CompareModels(MakeModel(), other).has_value());
}

}  // namespace
}  // namespace s3lam
