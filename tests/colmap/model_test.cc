// The real colmap program as the outside judge of the models written here.

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "s3lam/io/colmap_model.h"
#include "support/colmap_program.h"
#include "support/temp_dir.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using testing::ColmapAnalysis;
using testing::RunColmap;
using testing::TempDir;

class ColmapProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!testing::HasProgram("colmap")) GTEST_SKIP() << "colmap is not installed";
  }
};

Reconstruction SceneOfModel(int model) {
  return testing::MakeTestScene({.num_images = 5,
                                 .num_points = 50,
                                 .num_cameras = 2,
                                 .model = static_cast<CameraModel>(model)});
}

/// colmap's text form has about 17 digits, but it normalises quaternions on the way.
void ExpectNear(const Reconstruction& a, const Reconstruction& b, double tolerance) {
  ASSERT_EQ(a.cameras.size(), b.cameras.size());
  for (const auto& [id, camera] : a.cameras) {
    EXPECT_EQ(camera.model, b.cameras.at(id).model);
    EXPECT_EQ(camera.width, b.cameras.at(id).width);
    EXPECT_EQ(camera.height, b.cameras.at(id).height);
    EXPECT_EQ(camera.params, b.cameras.at(id).params);
  }
  ASSERT_EQ(a.images.size(), b.images.size());
  for (const auto& [id, image] : a.images) {
    const Image& other = b.images.at(id);
    EXPECT_EQ(image.name, other.name);
    EXPECT_EQ(image.camera_id, other.camera_id);
    EXPECT_LT(RotationAngle(image.cam_from_world.rotation, other.cam_from_world.rotation),
              tolerance);
    EXPECT_LT((image.cam_from_world.translation - other.cam_from_world.translation).norm(),
              tolerance);
    ASSERT_EQ(image.points2D.size(), other.points2D.size());
    for (size_t i = 0; i < image.points2D.size(); ++i) {
      EXPECT_LT((image.points2D[i].xy - other.points2D[i].xy).norm(), tolerance * 1e3);
      EXPECT_EQ(image.points2D[i].point_id, other.points2D[i].point_id);
    }
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (const auto& [id, point] : a.points) {
    const ScenePoint& other = b.points.at(id);
    EXPECT_LT((point.xyz - other.xyz).norm(), tolerance);
    EXPECT_EQ(point.color, other.color);
    EXPECT_NEAR(point.error, other.error, tolerance * 1e3);
    EXPECT_EQ(point.track, other.track);
  }
}

TEST_F(ColmapProgram, ConvertsOurModelToTextAndBack) {
  for (int i = 0; i < kNumCameraModels; ++i) {
    const Reconstruction model = SceneOfModel(i);
    const TempDir dir;
    for (const char* name : {"ours", "text", "binary"}) {
      std::filesystem::create_directory(dir / name);
    }
    WriteColmapModel(model, dir / "ours");
    RunColmap({"model_converter", "--input_path", (dir / "ours").string(), "--output_path",
               (dir / "text").string(), "--output_type", "TXT"});
    RunColmap({"model_converter", "--input_path", (dir / "text").string(), "--output_path",
               (dir / "binary").string(), "--output_type", "BIN"});
    for (const char* name : {"text", "binary"}) {
      ExpectNear(model, ReadColmapModel(dir / name), 1e-9);
    }
  }
}

TEST_F(ColmapProgram, ReadsOurText) {
  const Reconstruction model = SceneOfModel(4);
  const TempDir dir;
  std::filesystem::create_directory(dir / "ours");
  std::filesystem::create_directory(dir / "binary");
  WriteColmapModelText(model, dir / "ours");
  RunColmap({"model_converter", "--input_path", (dir / "ours").string(), "--output_path",
             (dir / "binary").string(), "--output_type", "BIN"});
  ExpectNear(model, ReadColmapModel(dir / "binary"), 1e-12);
}

TEST_F(ColmapProgram, AgreesOnTheNumbers) {
  for (int i = 0; i < kNumCameraModels; ++i) {
    const Reconstruction model = SceneOfModel(i);
    const TempDir dir;
    WriteColmapModel(model, dir.path());
    EXPECT_EQ(ColmapAnalysis(dir.path(), "Registered images"), 5.0);
    EXPECT_EQ(ColmapAnalysis(dir.path(), "Points"), static_cast<double>(model.points.size()));
    EXPECT_EQ(ColmapAnalysis(dir.path(), "Observations"),
              static_cast<double>(model.NumObservations()));
    const double mean_px = ComputeReprojectionStatistics(model).mean_px;
    EXPECT_GT(mean_px, 0.3);  // The scene has half a pixel of noise.
    EXPECT_NEAR(ColmapAnalysis(dir.path(), "Mean reprojection error"), mean_px, 1e-3);
  }
}

/// One step of colmap's own bundle adjustment evaluates the projections with colmap's formulas: its
/// initial cost is that of ours only if all camera models, poses and keypoints agree.
TEST_F(ColmapProgram, ProjectsAsWeDo) {
  for (int i = 0; i < kNumCameraModels; ++i) {
    const Reconstruction model = SceneOfModel(i);
    const TempDir dir;
    std::filesystem::create_directory(dir / "in");
    std::filesystem::create_directory(dir / "out");
    WriteColmapModel(model, dir / "in");
    const std::string output =
        RunColmap({"bundle_adjuster", "--input_path", (dir / "in").string(), "--output_path",
                   (dir / "out").string(), "--BundleAdjustment.max_num_iterations", "1"});
    const size_t place = output.find("Initial cost :");
    ASSERT_NE(place, std::string::npos) << output;
    // It prints the root of cost over residuals, of which there are two per observation.
    const double printed = std::strtod(output.c_str() + place + 14, nullptr);
    const double rms_px = ComputeReprojectionStatistics(model).rms_px;
    EXPECT_NEAR(printed, rms_px / 2.0, 2e-3) << CameraModelName(static_cast<CameraModel>(i));
  }
}

}  // namespace
}  // namespace s3lam
