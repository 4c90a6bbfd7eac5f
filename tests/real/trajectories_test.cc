// Errors of the published systems' trajectories on the real sequences, against numpy's.

#include <gtest/gtest.h>

#include <filesystem>

#include "eval/numpy_reference.h"
#include "s3lam/io/trajectory.h"

namespace s3lam {
namespace {

class RealTrajectories : public ::testing::TestWithParam<const char*> {};

TEST_P(RealTrajectories, ErrorsAgreeWithNumpy) {
  const std::filesystem::path data = S3LAM_TEST_DATA_DIR;
  if (data.empty()) GTEST_SKIP() << "no folder with real sequences given";
  const std::filesystem::path baselines = data.parent_path() / "baselines";
  if (!std::filesystem::is_directory(baselines)) {
    GTEST_SKIP() << "no trajectories of other systems in " << baselines;
  }
  const auto python = testing::PythonWithNumpy();
  if (!python) GTEST_SKIP() << "python3 with numpy is not installed";
  const std::string sequence = GetParam();
  const char* reference =
      sequence == "redkitchen" ? "trajectory_colour_sfm.txt" : "groundtruth.txt";
  const std::filesystem::path truth = data / sequence / reference;
  TrajectoryErrorOptions options;
  options.segment_lengths_m = {2.0, 5.0, 20.0, 50.0};
  size_t num_files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(baselines)) {
    const std::string name = entry.path().filename().string();
    if (name.find(sequence) == std::string::npos || name.find("_2_") != std::string::npos ||
        name.find("_3_") != std::string::npos) {
      continue;
    }
    SCOPED_TRACE(name);
    const auto errors =
        CompareTrajectories(ReadTrajectory(entry.path()), ReadTrajectory(truth), options);
    ASSERT_TRUE(errors.has_value());
    EXPECT_GT(errors->num_pairs, 20u);
    testing::ExpectAgreesWithNumpy(*python, entry.path(), truth, *errors);
    ++num_files;
  }
  EXPECT_GE(num_files, 4u);
}

INSTANTIATE_TEST_SUITE_P(Sequences, RealTrajectories,
                         ::testing::Values("kitti07", "mh05", "redkitchen"));

}  // namespace
}  // namespace s3lam
