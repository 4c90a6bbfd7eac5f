#include "s3lam/semantics/visibility.h"

#include <gtest/gtest.h>

#include "support/test_scene.h"

namespace s3lam {
namespace {

/// Three cameras in a row look along z at points 10 away; the first observes all points, the others
/// none. `apart` separates neighbours.
Reconstruction RowOfCameras(double apart) {
  Reconstruction scene;
  scene.cameras[CameraId(1)] = testing::MakeTestCamera(CameraModel::kSimplePinhole);
  for (uint32_t i = 0; i < 3; ++i) {
    Image& image = scene.images[ImageId(i)];
    image.id = ImageId(i);
    image.camera_id = CameraId(1);
    image.cam_from_world.translation = {-apart * i, 0, 0};
  }
  Image& first = scene.images.at(ImageId(0));
  for (uint32_t i = 0; i < 5; ++i) {
    ScenePoint& point = scene.points[PointId(i)];
    point.xyz = {0.2 * i, 0, 10};
    point.track = {{first.id, i}};
    first.points2D.push_back(
        {*scene.CameraOf(first).ImageFromCamera(first.cam_from_world * point.xyz), PointId(i)});
  }
  return scene;
}

TEST(VisibilityPredictor, FindsWhatANearbyImageObserves) {
  const Reconstruction scene = RowOfCameras(0.5);
  const PointRows rows(scene);
  const VisibilityPredictor predictor(scene, rows, VisibilityOptions{});
  const Image& second = scene.images.at(ImageId(1));
  const auto predictions = predictor.Predict(second);
  ASSERT_EQ(predictions.size(), 5U);
  for (size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(predictions[i].row, i);
    const auto xy = scene.CameraOf(second).ImageFromCamera(second.cam_from_world *
                                                           scene.points.at(PointId(i)).xyz);
    EXPECT_EQ(predictions[i].xy, *xy);
  }
  EXPECT_TRUE(predictor.Predict(scene.images.at(ImageId(0))).empty());  // It observes them.
}

TEST(VisibilityPredictor, KeepsToTheAngle) {
  const Reconstruction scene = RowOfCameras(1.2);  // 6.8 and 13.5 degrees.
  const PointRows rows(scene);
  const VisibilityPredictor predictor(scene, rows, VisibilityOptions{});
  EXPECT_FALSE(predictor.Predict(scene.images.at(ImageId(1))).empty());
  EXPECT_TRUE(predictor.Predict(scene.images.at(ImageId(2))).empty());
}

TEST(VisibilityPredictor, KeepsToTheDepthAndTheImage) {
  Reconstruction scene = RowOfCameras(0.0);
  scene.images.at(ImageId(1)).cam_from_world.translation.z() = -4.0;  // 10 becomes 6.
  scene.images.at(ImageId(2)).cam_from_world.rotation =
      QuaternionFromRotationVector({0.0, 0.65, 0.0});  // The points leave the image.
  const PointRows rows(scene);
  const VisibilityPredictor predictor(scene, rows, VisibilityOptions{});
  EXPECT_TRUE(predictor.Predict(scene.images.at(ImageId(1))).empty());
  EXPECT_TRUE(predictor.Predict(scene.images.at(ImageId(2))).empty());
}

TEST(VisibilityPredictor, CanBeSwitchedOff) {
  const Reconstruction scene = RowOfCameras(0.5);
  VisibilityOptions options;
  options.predict = false;
  const PointRows rows(scene);
  EXPECT_TRUE(
      VisibilityPredictor(scene, rows, options).Predict(scene.images.at(ImageId(1))).empty());
}

}  // namespace
}  // namespace s3lam
