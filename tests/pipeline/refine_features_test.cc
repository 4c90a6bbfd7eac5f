// What s3-refine does on request, as a user asks for it.

#include <nlohmann/json.hpp>

#include "pipeline/model_fixture.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

using nlohmann::json;
using testing::kDone;
using testing::RunTool;

class RefineFeatures : public testing::ModelTest {
 protected:
  void Run(const std::vector<std::string>& more) const {
    std::vector<std::string> arguments = RefineArguments();
    arguments.insert(arguments.end(), {"--output", output().string(), "--overwrite"});
    arguments.insert(arguments.end(), more.begin(), more.end());
    const auto result = RunTool("s3-refine", arguments);
    EXPECT_EQ(result.exit_code, kDone) << result.errors;
  }
  [[nodiscard]] json Report() const { return ReadJson(output() / "report.json"); }
};

TEST_F(RefineFeatures, CovariancesAreWrittenOnRequestOnly) {
  Run({});
  EXPECT_FALSE(std::filesystem::exists(output() / "covariance.json"));
  Run({"--covariance"});
  const json covariance = ReadJson(output() / "covariance.json");
  // The first image holds the world.
  EXPECT_EQ(covariance["poses"].size(), ReadColmapModel(model()).images.size() - 1);
  for (const json& pose : covariance["poses"]) {
    ASSERT_EQ(pose["covariance"].size(), 36u);
    for (size_t i = 0; i < 6; ++i) EXPECT_GE(pose["covariance"][7 * i].get<double>(), 0.0);
  }
  EXPECT_FALSE(covariance["planes"].empty());
}

TEST_F(RefineFeatures, GravityPutsTheLowestSurfaceAtZero) {
  Run({"--gravity"});
  const json gravity = Report()["gravity"];
  ASSERT_TRUE(gravity["aligned"]) << gravity["reason"];
  ASSERT_TRUE(gravity["floor_plane"].is_number());
  const json planes = ReadJson(output() / "planes.json")["planes"];
  for (const json& plane : planes) {
    if (plane["id"] != gravity["floor_plane"]) continue;
    EXPECT_GT(plane["normal_in_world"][2].get<double>(), 0.999);
    EXPECT_NEAR(plane["centroid_in_world"][2].get<double>(), 0.0, 1e-9);
  }
  for (const auto& [id, image] : ReadColmapModel(output()).images) {
    EXPECT_GT(image.cam_from_world.CenterInB().z(), 0.0);
  }
}

TEST_F(RefineFeatures, AllImagesCanBeKept) {
  inputs_.Write("constant.json", R"({"images": "all"})");
  Run({"--constant", (inputs_ / "constant.json").string()});
  const Reconstruction before = ReadColmapModel(model());
  for (const auto& [id, image] : ReadColmapModel(output()).images) {
    EXPECT_EQ(image.cam_from_world.translation, before.images.at(id).cam_from_world.translation);
    EXPECT_EQ(image.cam_from_world.rotation.coeffs(),
              before.images.at(id).cam_from_world.rotation.coeffs());
  }
}

TEST_F(RefineFeatures, RefinedCamerasAreWritten) {
  Run({"--set", "intrinsics.focal_length=true", "--set", "intrinsics.min_observations=100"});
  const json camera = Report()["cameras"][0];
  EXPECT_TRUE(camera["refined"]) << camera["reason"];
  EXPECT_EQ(ReadColmapModel(output()).cameras.begin()->second.params,
            camera["params_after"].get<std::vector<double>>());
  EXPECT_NE(camera["params_before"], camera["params_after"]);
}

TEST_F(RefineFeatures, ThatNoCameraIsRefinedIsSaid) {
  std::vector<std::string> arguments = RefineArguments();
  arguments.insert(arguments.end(),
                   {"--output", output().string(), "--set", "intrinsics.focal_length=true", "--set",
                    "intrinsics.min_images=9"});
  const auto result = RunTool("s3-refine", arguments);
  EXPECT_EQ(result.exit_code, kDone) << result.errors;
  EXPECT_THAT(result.errors, ::testing::HasSubstr("no camera is refined"));
  EXPECT_THAT(result.errors, ::testing::HasSubstr("intrinsics.shared"));
}

TEST_F(RefineFeatures, TheReportIsAlsoATable) {
  Run({"--set", "planes.mode=hard"});
  EXPECT_EQ(Report()["plane_mode"], "hard");
  EXPECT_THAT(ReadFile(output() / "report.txt"), ::testing::HasSubstr("reprojection RMS [px]"));
}

}  // namespace
}  // namespace s3lam
