#include "s3lam/semantics/pipeline.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "s3lam/base/error.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using ::testing::HasSubstr;

constexpr uint32_t kFloorSegment = 5;
constexpr uint32_t kBoxSegment = 70000;

ClassTable Table() {
  ClassTable table{"test", {}};
  table.classes.push_back(
      {1, "box", true, false, false, 20, SurfaceOrientation::kAny, {255, 0, 0}});
  table.classes.push_back({4, "floor", false, true, false, 20, {}, {0, 255, 0}});
  return table;
}

/// Points on z = 0; the part with x < -0.4 is called box, the rest floor.
class FlatScene {
 public:
  FlatScene() {
    testing::TestSceneOptions options;
    options.planar = true;
    options.num_points = 300;
    options.num_images = 8;
    scene_ = testing::MakeTestScene(options);
  }

  /// Masks that follow the truth: a pixel is a box if the floor point it sees has x < -0.4.
  [[nodiscard]] PanopticFrame Mask(const Image& image, int scale = 1) const {
    const Camera& camera = scene_.CameraOf(image);
    PanopticFrame frame;
    frame.source = image.name;
    frame.segment_ids.resize(camera.height / scale, camera.width / scale);
    const Rigid3 world_from_cam = image.cam_from_world.Inverse();
    for (Eigen::Index y = 0; y < frame.segment_ids.rows(); ++y) {
      for (Eigen::Index x = 0; x < frame.segment_ids.cols(); ++x) {
        const Eigen::Vector2d pixel(scale * (static_cast<double>(x) + 0.5),
                                    scale * (static_cast<double>(y) + 0.5));
        const Eigen::Vector2d uv = *camera.CameraFromImage(pixel);
        const Eigen::Vector3d ray = world_from_cam.rotation * Eigen::Vector3d(uv.x(), uv.y(), 1.0);
        const Eigen::Vector3d hit =
            world_from_cam.translation - world_from_cam.translation.z() / ray.z() * ray;
        frame.segment_ids(y, x) = hit.x() < -0.4 ? kBoxSegment : kFloorSegment;
      }
    }
    frame.segments[kFloorSegment].class_index = 1;
    frame.segments[kBoxSegment].class_index = 0;
    return frame;
  }

  [[nodiscard]] const Reconstruction& scene() const { return scene_; }

 private:
  Reconstruction scene_;
};

LiftResult Lift(const FlatScene& flat, const LiftOptions& options, int scale = 1) {
  return LiftSemantics(
      flat.scene(), Table(), [&](const Image& image) { return flat.Mask(image, scale); }, {},
      options);
}

void ExpectRightResult(const FlatScene& flat, const SemanticMap& map) {
  CheckSemanticMap(map, flat.scene(), "map");
  ASSERT_EQ(map.points.size(), flat.scene().points.size());
  size_t wrong = 0;
  for (size_t row = 0; row < map.points.size(); ++row) {
    const double x = flat.scene().points.at(map.points[row]).xyz.x();
    const bool is_floor = MostLikelyClass(map.distributions, row) == 1;
    if (std::abs(x + 0.4) > 0.02 && is_floor != (x > -0.4)) ++wrong;
  }
  EXPECT_EQ(wrong, 0U);
  ASSERT_EQ(map.clusters.size(), 2U);
  ASSERT_EQ(map.planes.size(), 1U);
  const PlanarSurface& plane = map.planes.begin()->second;
  EXPECT_EQ(plane.class_index, 1);
  EXPECT_GT(plane.plane_in_world.normal.z(), 0.0);  // The cameras are above.
  EXPECT_LT(PlaneAngle(plane.plane_in_world, Plane{}), 0.5 * std::numbers::pi / 180.0);
  EXPECT_NEAR(plane.plane_in_world.offset, 0.0, 0.02);
  EXPECT_NEAR(
      (plane.axis_u_in_world.cross(plane.axis_v_in_world) - plane.plane_in_world.normal).norm(),
      0.0, 1e-9);
  EXPECT_GE(plane.extent.size(), 3U);
}

class Pipeline : public ::testing::TestWithParam<InstanceMethod> {};

TEST_P(Pipeline, LabelsClustersAndFits) {
  const FlatScene flat;
  LiftOptions options;
  options.instances = GetParam();
  const LiftResult result = Lift(flat, options);
  ExpectRightResult(flat, result.map);
  EXPECT_EQ(result.report.num_images_with_mask, 8U);
  EXPECT_EQ(result.report.classes.at(1).planes, 1U);
}

TEST_P(Pipeline, DoesNotDependOnThreads) {
  const FlatScene flat;
  LiftOptions options;
  options.instances = GetParam();
  options.num_threads = 1;
  const SemanticMap one = Lift(flat, options).map;
  options.num_threads = 3;
  const SemanticMap three = Lift(flat, options).map;
  EXPECT_EQ(one.distributions, three.distributions);
  EXPECT_EQ(one.cluster_of_point, three.cluster_of_point);
  ASSERT_EQ(one.planes.size(), three.planes.size());
  EXPECT_EQ(one.planes.begin()->second.plane_in_world.normal,
            three.planes.begin()->second.plane_in_world.normal);
}

TEST_P(Pipeline, TakesMasksOfAnotherResolution) {
  const FlatScene flat;
  LiftOptions options;
  options.instances = GetParam();
  const LiftResult result = Lift(flat, options, 2);
  ExpectRightResult(flat, result.map);
  EXPECT_EQ(result.report.num_scaled_masks, 8U);
}

INSTANTIATE_TEST_SUITE_P(Methods, Pipeline,
                         ::testing::Values(InstanceMethod::kIou, InstanceMethod::kConsensus));

TEST(LiftSemantics, CountsImagesWithoutMask) {
  const FlatScene flat;
  const LiftResult result = LiftSemantics(
      flat.scene(), Table(),
      [&](const Image& image) -> std::optional<PanopticFrame> {
        if (image.id.value() < 8) return std::nullopt;  // The first two.
        return flat.Mask(image);
      },
      {}, LiftOptions{});
  EXPECT_EQ(result.report.num_images_with_mask, 6U);
  EXPECT_EQ(result.report.num_images_without_mask, 2U);
}

TEST(LiftSemantics, RefusesModelsWithoutAnyMask) {
  const FlatScene flat;
  EXPECT_THROW(
      LiftSemantics(
          flat.scene(), Table(), [](const Image&) { return std::nullopt; }, {}, LiftOptions{}),
      InputError);
}

TEST(LiftSemantics, RefusesMasksOfAnotherShape) {
  const FlatScene flat;
  const auto masks = [&](const Image& image) {
    PanopticFrame frame = flat.Mask(image, 4);
    frame.segment_ids.conservativeResize(100, 160);
    return frame;
  };
  try {
    LiftSemantics(flat.scene(), Table(), masks, {}, LiftOptions{});
    FAIL() << "accepted";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("160 x 100"));
    EXPECT_THAT(error.what(), HasSubstr("640 x 480"));
  }
}

TEST(CheckMaskShape, SaysWhatMayHaveGoneWrong) {
  Camera camera;
  camera.width = 640;
  camera.height = 480;
  const auto error = [&](int width, int height) -> std::string {
    PanopticFrame mask;
    mask.segment_ids.resize(height, width);
    try {
      CheckMaskShape(mask, camera, "a.png");
    } catch (const InputError& refused) {
      return refused.what();
    }
    return "";
  };
  for (const auto& [width, height] : {std::pair(480, 640), std::pair(240, 320)}) {
    EXPECT_THAT(error(width, height), HasSubstr("EXIF orientation"));
  }
  for (const auto& [width, height] : {std::pair(512, 512), std::pair(320, 242)}) {
    EXPECT_THAT(error(width, height), HasSubstr("aspect ratio"));
  }
  for (const auto& [width, height] : {std::pair(320, 240), std::pair(320, 241)}) {
    EXPECT_EQ(error(width, height), "");
  }
}

TEST(LiftSemantics, SkipsBadMasksIfLenient) {
  const FlatScene flat;
  const auto masks = [&](const Image& image) {
    if (image.id.value() == 5) throw InputError("bad.png: damaged");
    return std::optional(flat.Mask(image));
  };
  LiftOptions options;
  EXPECT_THROW(LiftSemantics(flat.scene(), Table(), masks, {}, options), InputError);
  options.lookup.lenient = true;
  const LiftResult result = LiftSemantics(flat.scene(), Table(), masks, {}, options);
  EXPECT_EQ(result.report.num_images_with_bad_mask, 1U);
  EXPECT_EQ(result.report.num_images_with_mask, 7U);
  ExpectRightResult(flat, result.map);
}

TEST(Colors, FollowClassesAndClusters) {
  const FlatScene flat;
  const SemanticMap map = Lift(flat, LiftOptions{}).map;
  const Reconstruction by_class = ColorByClass(flat.scene(), map);
  const Reconstruction by_cluster = ColorByCluster(flat.scene(), map);
  for (const auto& [id, cluster] : map.clusters) {
    const Rgb cluster_color = by_cluster.points.at(cluster.points.front()).color;
    for (const PointId point : cluster.points) {
      EXPECT_EQ(by_class.points.at(point).color,
                map.class_table.classes[static_cast<size_t>(cluster.class_index)].color);
      EXPECT_EQ(by_cluster.points.at(point).color, cluster_color);
    }
  }
  EXPECT_NE(by_cluster.points.at(map.clusters.at(ClusterId(0)).points.front()).color,
            by_cluster.points.at(map.clusters.at(ClusterId(1)).points.front()).color);
}

}  // namespace
}  // namespace s3lam
