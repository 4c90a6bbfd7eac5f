#include <gtest/gtest.h>

#include <filesystem>

#include "s3lam/io/colmap_model.h"
#include "support/colmap_program.h"

namespace s3lam {
namespace {

class RealColmapModel : public ::testing::TestWithParam<const char*> {};

TEST_P(RealColmapModel, MeanReprojectionErrorIsColmaps) {
  const std::filesystem::path data = S3LAM_TEST_DATA_DIR;
  if (data.empty()) GTEST_SKIP() << "no folder with real sequences given";
  if (!testing::HasProgram("colmap")) GTEST_SKIP() << "colmap is not installed";
  const std::filesystem::path path = data / GetParam() / "colmap_model";
  const ReprojectionStatistics statistics = ComputeReprojectionStatistics(ReadColmapModel(path));
  EXPECT_GT(statistics.num_observations, 10000u);
  EXPECT_NEAR(testing::ColmapAnalysis(path, "Mean reprojection error"), statistics.mean_px, 1e-3);
}

INSTANTIATE_TEST_SUITE_P(Sequences, RealColmapModel, ::testing::Values("kitti07", "redkitchen"));

}  // namespace
}  // namespace s3lam
