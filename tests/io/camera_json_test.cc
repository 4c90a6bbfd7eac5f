#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "s3lam/base/error.h"
#include "s3lam/io/image_sequence.h"
#include "support/temp_dir.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::TempDir;
using ::testing::ThrowsMessage;

TEST(CameraJson, RoundTripIsExact) {
  const TempDir dir;
  for (int i = 0; i < kNumCameraModels; ++i) {
    CameraFile file;
    file.camera = testing::MakeTestCamera(static_cast<CameraModel>(i));
    if (i % 2 == 0) file.fps = 29.97;
    WriteCameraJson(file, dir / "camera.json");
    const CameraFile read = ReadCameraJson(dir / "camera.json");
    EXPECT_EQ(read.camera.model, file.camera.model);
    EXPECT_EQ(read.camera.width, file.camera.width);
    EXPECT_EQ(read.camera.height, file.camera.height);
    EXPECT_EQ(read.camera.params, file.camera.params);
    EXPECT_EQ(read.fps, file.fps);
  }
}

TEST(CameraJson, FaultsAreNamed) {
  const TempDir dir;
  const auto expect_error = [&](const std::string& json, const std::string& message) {
    const auto path = dir.Write("camera.json", json);
    EXPECT_THAT([&] { ReadCameraJson(path); },
                ThrowsMessage<InputError>(AllOf(HasSubstr("camera.json"), HasSubstr(message))))
        << json;
  };
  expect_error("{", "not valid JSON");
  expect_error("[]", "expected an object");
  expect_error("{}", "'model' is missing");
  expect_error(R"({"model": "PINHOLE", "width": 640, "height": 480})", "'params' is missing");
  expect_error(R"({"model": "PINHOLE", "hight": 480})", "'hight'; did you mean 'height'");
  expect_error(R"({"model": "BROWN", "width": 640, "height": 480, "params": []})", "BROWN");
  const std::string size = R"({"model": "PINHOLE", "width": 640, "height": 480, )";
  expect_error(size + R"("params": [1, 1, 2]})", "4 parameters, got 3");
  expect_error(size + R"("params": [1, 1, 2, "x"]})", "'params'");
  expect_error(size + R"("params": [-1, 1, 2, 3]})", "focal length");
  expect_error(size + R"("params": [1, 1, 2, 3], "fps": 0})", "'fps'");
  expect_error(R"({"model": "PINHOLE", "width": 0, "height": 480, "params": [1, 1, 2, 3]})",
               "not positive");
}

TEST(CameraJson, PresetsSeeTheirWholeImage) {
  size_t count = 0;
  const std::filesystem::path folder =
      std::filesystem::path(S3LAM_TEST_SOURCE_DIR) / "configs/cameras";
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const CameraFile file = ReadCameraJson(entry.path());
    EXPECT_TRUE(file.fps.has_value()) << entry.path();
    const Camera& camera = file.camera;
    for (double y = 0.5; y < camera.height; y += 15.5) {
      for (double x = 0.5; x < camera.width; x += 15.5) {
        const auto ray = camera.CameraFromImage({x, y});
        ASSERT_TRUE(ray.has_value()) << entry.path() << " " << x << " " << y;
        const auto back = camera.ImageFromCamera(ray->homogeneous());
        ASSERT_TRUE(back.has_value());
        EXPECT_LT((*back - Eigen::Vector2d(x, y)).norm(), 1e-6);
      }
    }
    ++count;
  }
  EXPECT_GE(count, 7u);
}

}  // namespace
}  // namespace s3lam
