// The real colmap program as the outside judge of what the stages write.

#include <cmath>

#include "chain/chain_support.h"
#include "s3lam/io/colmap_model.h"
#include "support/colmap_program.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using testing::ChainFolder;
using testing::ColmapAnalysis;
using testing::RunColmap;
using testing::TempDir;

class StageOutput : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    if (!testing::HasProgram("colmap")) GTEST_SKIP() << "colmap is not installed";
  }
  [[nodiscard]] static std::filesystem::path Model() { return ChainFolder(GetParam()); }
};
INSTANTIATE_TEST_SUITE_P(Models, StageOutput,
                         ::testing::Values("1_slam", "3_refine_plain", "3_refine_clean",
                                           "2_lift_clean/model_by_class",
                                           "2_lift_clean/model_by_cluster"),
                         [](const auto& test) {
                           std::string name = test.param;
                           std::replace(name.begin(), name.end(), '/', '_');
                           return name;
                         });

TEST_P(StageOutput, AnalyzerSeesTheSameModel) {
  const Reconstruction model = ReadColmapModel(Model());
  EXPECT_EQ(ColmapAnalysis(Model(), "Registered images"), model.images.size());
  EXPECT_EQ(ColmapAnalysis(Model(), "Points"), model.points.size());
  EXPECT_EQ(ColmapAnalysis(Model(), "Observations"), model.NumObservations());
  EXPECT_NEAR(ColmapAnalysis(Model(), "Mean reprojection error"),
              ComputeReprojectionStatistics(model).mean_px, 1e-2);
}

TEST_P(StageOutput, ConverterBringsItBackUnchanged) {
  const TempDir dir;
  for (const char* name : {"text", "binary"}) std::filesystem::create_directory(dir / name);
  RunColmap({"model_converter", "--input_path", Model().string(), "--output_path",
             (dir / "text").string(), "--output_type", "TXT"});
  RunColmap({"model_converter", "--input_path", (dir / "text").string(), "--output_path",
             (dir / "binary").string(), "--output_type", "BIN"});
  const Reconstruction before = ReadColmapModel(Model());
  const Reconstruction after = ReadColmapModel(dir / "binary");
  EXPECT_EQ(after.images.size(), before.images.size());
  EXPECT_EQ(after.NumObservations(), before.NumObservations());
  ASSERT_EQ(after.points.size(), before.points.size());
  for (const auto& [id, point] : before.points) {
    EXPECT_LT((after.points.at(id).xyz - point.xyz).norm(), 1e-9);
    EXPECT_EQ(after.points.at(id).color, point.color);
  }
}

/// colmap evaluates the projections with its own formulas, and with fixed intrinsics finds nothing
/// much to improve.
TEST_P(StageOutput, BundleAdjusterAgreesWithTheResiduals) {
  const TempDir dir;
  const std::string output = RunColmap(
      {"bundle_adjuster", "--input_path", Model().string(), "--output_path", dir.path().string(),
       "--BundleAdjustment.max_num_iterations", "10", "--BundleAdjustment.refine_focal_length", "0",
       "--BundleAdjustment.refine_extra_params", "0"});
  const size_t place = output.find("Initial cost :");
  ASSERT_NE(place, std::string::npos) << output;
  // It prints the root of cost over residuals, of which there are two per observation.
  const double printed = std::strtod(output.c_str() + place + 14, nullptr);
  const double rms_px = ComputeReprojectionStatistics(ReadColmapModel(Model())).rms_px;
  EXPECT_NEAR(printed, rms_px / 2.0, 2e-3);
  EXPECT_LT(rms_px, 1.0);
}

/// COLMAP goes on from our keypoints and matches.
class Database : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!testing::HasProgram("colmap")) GTEST_SKIP() << "colmap is not installed";
    // COLMAP opens it for writing.
    std::filesystem::copy_file(ChainFolder("1_slam") / "database.db", dir_ / "database.db");
  }
  std::string Run(const std::string& command, const std::vector<std::string>& more) const {
    std::vector<std::string> words = {
        command,        "--database_path",         (dir_ / "database.db").string(),
        "--image_path", ChainFolder("scene"),      "--output_path",
        dir_.path(),    "--Mapper.extract_colors", "0"};
    words.insert(words.end(), more.begin(), more.end());
    return RunColmap(words);
  }
  TempDir dir_;
};

TEST_F(Database, TriangulatorFindsOurPointsAgain) {
  const auto model = ChainFolder("1_slam");
  const Reconstruction ours = ReadColmapModel(model);
  Run("point_triangulator", {"--input_path", model.string()});
  EXPECT_EQ(ColmapAnalysis(dir_.path(), "Registered images"), ours.images.size());
  EXPECT_GT(ColmapAnalysis(dir_.path(), "Points"), 0.7 * static_cast<double>(ours.points.size()));
  EXPECT_LT(ColmapAnalysis(dir_.path(), "Mean reprojection error"), 1.0);
}

TEST_F(Database, MapperBuildsTheMapFromNothing) {
  const Reconstruction ours = ReadColmapModel(ChainFolder("1_slam"));
  Run("mapper", {});
  EXPECT_EQ(ColmapAnalysis(dir_ / "0", "Registered images"), ours.images.size());
  EXPECT_LT(ColmapAnalysis(dir_ / "0", "Mean reprojection error"), 1.0);
}

}  // namespace
}  // namespace s3lam
