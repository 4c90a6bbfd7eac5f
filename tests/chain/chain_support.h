#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "s3lam/io/file.h"
#include "support/run_program.h"
#include "support/temp_dir.h"

namespace s3lam::testing {

/// What tests/chain/make.sh left: scene/, 1_slam/, 2_lift_*/, 3_refine_*/. ctest runs it before the
/// tests that need it.
inline std::filesystem::path ChainFolder(const std::string& name) {
  const std::filesystem::path folder = std::filesystem::path(S3LAM_TEST_CHAIN_DIR) / name;
  if (!std::filesystem::exists(folder)) {
    throw std::runtime_error(folder.string() + " is missing: run ctest -R chain.make first");
  }
  return folder;
}

inline nlohmann::json ChainReport(const std::string& name) {
  return ReadJson(ChainFolder(name) / "report.json");
}

inline std::string Tool(const std::string& name) {
  return (std::filesystem::path(S3LAM_TEST_BIN_DIR) / name).string();
}

/// What s3-eval says of a trajectory of the chain, after Sim(3) alignment.
inline nlohmann::json ChainTrajectoryError(const std::string& name,
                                           const std::string& file = "frames.txt") {
  const ProgramResult result = RunProgramApart(
      {Tool("s3-eval"), "--quiet", "--json", "--estimate", (ChainFolder(name) / file).string(),
       "--ground-truth", (ChainFolder("scene") / "groundtruth.txt").string()});
  if (result.exit_code != 0) throw std::runtime_error(result.errors);
  return nlohmann::json::parse(result.output)["trajectory"];
}

/// Absolute trajectory error [m], RMSE.
inline double ChainAte(const std::string& name, const std::string& file = "frames.txt") {
  return ChainTrajectoryError(name, file)["ate"]["translation"]["rmse"].get<double>();
}

/// Every file of `folder` but the reports, which have times, is the same in `other`.
inline void ExpectSameBytes(const std::filesystem::path& folder,
                            const std::filesystem::path& other) {
  size_t compared = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file() || entry.path().stem() == "report") continue;
    const auto relative = std::filesystem::relative(entry.path(), folder);
    ASSERT_TRUE(std::filesystem::exists(other / relative)) << relative;
    EXPECT_TRUE(FileBytes(entry.path()) == FileBytes(other / relative)) << relative << " differs";
    ++compared;
  }
  EXPECT_GT(compared, 3u);
}

}  // namespace s3lam::testing
