#include "s3lam/semantics/plane_fitting.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "s3lam/base/rng.h"
#include "support/captured_log.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

/// A map with one cluster of class "wall" that holds all points.
SemanticMap OneCluster(const Reconstruction& scene, bool is_planar) {
  SemanticMap map;
  map.class_table.classes.push_back({1, "wall", false, is_planar, false, 30, {}, {}});
  Cluster cluster;
  cluster.id = ClusterId(3);
  for (const auto& [id, point] : scene.points) cluster.points.push_back(id);
  map.clusters[cluster.id] = cluster;
  return map;
}

Reconstruction FlatScene(int num_points = 200) {
  testing::TestSceneOptions options;
  options.planar = true;
  options.num_points = num_points;
  return testing::MakeTestScene(options);
}

/// The test scene with the points moved onto two walls that meet at a right angle (z = 0, x = 0).
Reconstruction CornerScene() {
  testing::TestSceneOptions options;
  options.num_points = 400;
  options.noise_px = 0.0;
  Reconstruction scene = testing::MakeTestScene(options);
  bool floor = false;
  for (auto& [id, point] : scene.points) {
    floor = !floor;
    (floor ? point.xyz.z() : point.xyz.x()) = 0.0;
  }
  for (auto& [id, image] : scene.images) {
    for (Point2D& keypoint : image.points2D) {
      if (!keypoint.point_id.valid()) continue;
      keypoint.xy = *scene.CameraOf(image).ImageFromCamera(image.cam_from_world *
                                                           scene.points.at(keypoint.point_id).xyz);
    }
  }
  return scene;
}

TEST(FitPlanes, FitsAFloorSeenFromAbove) {
  const Reconstruction scene = FlatScene();
  SemanticMap map = OneCluster(scene, true);
  FitPlanes(scene, EstimateKeypointSigma(scene), PlaneFittingOptions{}, 0, 1, map);
  ASSERT_EQ(map.planes.size(), 1U);
  const PlanarSurface& plane = map.planes.at(PlaneId(0));
  EXPECT_EQ(plane.cluster_id, ClusterId(3));
  EXPECT_GT(plane.plane_in_world.normal.z(), std::cos(0.5 * kDegree));
  EXPECT_GT(plane.inliers.size(), 150U);
  EXPECT_TRUE(std::is_sorted(plane.inliers.begin(), plane.inliers.end()));
  for (const Eigen::Vector2d& corner : plane.extent) EXPECT_LT(corner.norm(), 1.5 * std::sqrt(2.0));
}

TEST(FitPlanes, FindsSeveralPlanesInACluster) {
  const Reconstruction scene = CornerScene();
  SemanticMap map = OneCluster(scene, true);
  FitPlanes(scene, EstimateKeypointSigma(scene), PlaneFittingOptions{}, 0, 1, map);
  ASSERT_EQ(map.planes.size(), 2U);
  EXPECT_NEAR(PlaneAngle(map.planes.at(PlaneId(0)).plane_in_world,
                         map.planes.at(PlaneId(1)).plane_in_world),
              90.0 * kDegree, 0.5 * kDegree);
}

TEST(FitPlanes, GoesOnAfterARefusal) {
  Reconstruction scene = FlatScene(500);
  size_t number = 0;
  for (auto& [id, point] : scene.points) {  // Most of a strip above the floor.
    if (++number > 300) continue;
    point.xyz.y() *= 0.1;
    point.xyz.z() = 0.5;
  }
  SemanticMap map = OneCluster(scene, true);
  PlaneFittingOptions options;
  FitPlanes(scene, 0.5, options, 0, 1, map);
  EXPECT_EQ(map.planes.size(), 2U);
  options.fit.min_width_ratio = 0.3;
  FitPlanes(scene, 0.5, options, 0, 1, map);
  ASSERT_EQ(map.planes.size(), 1U);
  EXPECT_NEAR(map.planes.begin()->second.centroid_in_world.z(), 0.0, 0.01);
}

TEST(FitPlanes, TellsWhenALimitLeavesPointsWithoutAPlane) {
  const Reconstruction scene = CornerScene();
  SemanticMap map = OneCluster(scene, true);
  PlaneFittingOptions options;
  const auto log_of_fitting = [&](int max_planes) {
    options.max_planes_per_cluster = max_planes;
    const testing::CapturedLog log;
    FitPlanes(scene, EstimateKeypointSigma(scene), options, 0, 1, map);
    return log.text();
  };
  const std::string text = log_of_fitting(1);
  EXPECT_EQ(map.planes.size(), 1U);
  for (const char* part : {"wall", "cluster 3", "points left", "max_planes_per_cluster"}) {
    EXPECT_THAT(text, ::testing::HasSubstr(part));
  }
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1);
  EXPECT_EQ(log_of_fitting(2), "");
  EXPECT_EQ(log_of_fitting(0), "");
}

TEST(FitPlanes, TakesLayersOverEachOtherForOneSurface) {
  Reconstruction scene = FlatScene(600);
  Rng rng(5);
  // Far less certain than their observations claim, as if poses were off.
  for (auto& [id, point] : scene.points) point.xyz.z() += rng.Gaussian(0.0, 0.1);
  SemanticMap map = OneCluster(scene, true);
  PlaneFittingOptions options;
  FitPlanes(scene, EstimateKeypointSigma(scene), options, 0, 1, map);
  ASSERT_EQ(map.planes.size(), 1U);
  EXPECT_GT(map.planes.begin()->second.plane_in_world.normal.z(), std::cos(1.0 * kDegree));
  options.layer_sigmas = options.merge_sigmas;
  options.layer_angle_deg = options.merge_angle_deg;
  FitPlanes(scene, EstimateKeypointSigma(scene), options, 0, 1, map);
  EXPECT_GT(map.planes.size(), 1U);
}

TEST(FitPlanes, TakesSurfacesThatNearlyLineUpForTwo) {
  constexpr double kStep = 0.06;
  Reconstruction scene = FlatScene(800);
  Rng rng(5);
  SemanticMap map = OneCluster(scene, true);
  std::erase_if(map.clusters.begin()->second.points,
                [&](PointId id) { return std::abs(scene.points.at(id).xyz.x()) < 0.5; });
  for (auto& [id, point] : scene.points) {
    point.xyz.z() = (point.xyz.x() > 0.0 ? kStep : 0.0) + rng.Gaussian(0.0, 0.003);
  }
  PlaneFittingOptions options;
  options.roughness = 0.01;  // Far more than there is: one plane holds both surfaces.
  FitPlanes(scene, EstimateKeypointSigma(scene), options, 0, 1, map);
  ASSERT_EQ(map.planes.size(), 2U);
  for (const auto& [id, plane] : map.planes) {
    EXPECT_GT(plane.plane_in_world.normal.z(), std::cos(0.3 * kDegree));
    const double height = plane.centroid_in_world.x() > 0.0 ? kStep : 0.0;
    EXPECT_NEAR(plane.centroid_in_world.z(), height, 0.003);
  }
}

TEST(FitPlanes, PrefersTheExpectedOfTwoLikelyPlanes) {
  constexpr double kTilt = 8.0 * kDegree;
  testing::TestSceneOptions scene_options;
  scene_options.num_points = 600;
  scene_options.noise_px = 0.0;
  Reconstruction scene = testing::MakeTestScene(scene_options);
  SemanticMap map = OneCluster(scene, true);
  map.clusters.begin()->second.points.clear();
  map.class_table.classes[0].orientation = SurfaceOrientation::kVertical;
  map.class_table.classes.push_back(
      {2, "floor", false, true, false, 30, SurfaceOrientation::kHorizontal, {}});
  Cluster floor;
  floor.id = ClusterId(4);
  floor.class_index = 1;
  int number = 0;
  for (auto& [id, point] : scene.points) {  // More on the leaning wall than on the upright.
    if (++number <= 200) {
      point.xyz.z() = 0.0;
      floor.points.push_back(id);
      continue;
    }
    point.xyz.x() = number <= 380 ? 0.0 : std::tan(kTilt) * point.xyz.z();
    map.clusters.begin()->second.points.push_back(id);
  }
  map.clusters[floor.id] = floor;
  const double sigma_px = 0.5;
  PlaneFittingOptions options;
  options.merge_angle_deg = options.layer_angle_deg = 1.0;
  const auto lean_of_first = [&] {
    FitPlanes(scene, sigma_px, options, 0, 1, map);
    return std::asin(std::abs(map.planes.at(PlaneId(0)).plane_in_world.normal.z())) / kDegree;
  };
  options.exact_share = 0.8;
  EXPECT_LT(lean_of_first(), 2.0);
  options.exact_share = 1.0;
  EXPECT_GT(lean_of_first(), 4.0);
}

TEST(FitPlanes, GivesClassesThatAreNotPlanarNone) {
  const Reconstruction scene = FlatScene();
  SemanticMap map = OneCluster(scene, false);
  FitPlanes(scene, EstimateKeypointSigma(scene), PlaneFittingOptions{}, 0, 1, map);
  EXPECT_TRUE(map.planes.empty());
}

TEST(FitPlanes, WantsTheClassesMinimumOfInliers) {
  const Reconstruction scene = FlatScene();
  SemanticMap map = OneCluster(scene, true);
  map.class_table.classes[0].min_plane_inliers = 201;
  FitPlanes(scene, EstimateKeypointSigma(scene), PlaneFittingOptions{}, 0, 1, map);
  EXPECT_TRUE(map.planes.empty());
}

TEST(FitPlanes, RefusesPointsWithoutAnySurface) {
  testing::TestSceneOptions options;
  options.num_points = 300;  // All over a cube.
  const Reconstruction scene = testing::MakeTestScene(options);
  SemanticMap map = OneCluster(scene, true);
  FitPlanes(scene, EstimateKeypointSigma(scene), PlaneFittingOptions{}, 0, 1, map);
  EXPECT_TRUE(map.planes.empty());
}

TEST(PointCovariance, IsLongAlongTheViewingDirection) {
  Reconstruction scene;
  const CameraId camera_id(1);
  scene.cameras[camera_id] = testing::MakeTestCamera(CameraModel::kSimplePinhole, camera_id);
  ScenePoint point;
  point.xyz = {0, 0, 10};
  for (uint32_t i = 0; i < 2; ++i) {
    Image image;
    image.id = ImageId(i);
    image.camera_id = camera_id;
    image.cam_from_world.translation = {i == 0 ? -0.5 : 0.5, 0, 0};
    scene.images[image.id] = image;
    point.track.push_back({image.id, 0});
  }
  const auto covariance = PointCovariance(scene, point, 1.0);
  ASSERT_TRUE(covariance);
  // Two rays at a base of 1: sigma_x = z / (f sqrt 2), sigma_z = sqrt 2 z^2 / (f b).
  EXPECT_NEAR(std::sqrt((*covariance)(0, 0)), 10.0 / 500.0 / std::sqrt(2.0), 1e-3);
  EXPECT_NEAR(std::sqrt((*covariance)(2, 2)), std::sqrt(2.0) * 100.0 / 500.0, 1e-2);
  point.track.pop_back();
  EXPECT_FALSE(PointCovariance(scene, point, 1.0));
}

TEST(EstimateKeypointSigma, RecoversTheNoise) {
  testing::TestSceneOptions options;
  options.noise_px = 0.8;
  options.num_points = 500;
  options.num_images = 40;  // Points stay at the truth, so the correction must be small.
  EXPECT_NEAR(EstimateKeypointSigma(testing::MakeTestScene(options)), 0.8, 0.05);
}

}  // namespace
}  // namespace s3lam
