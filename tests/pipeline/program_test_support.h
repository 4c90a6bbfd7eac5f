#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "support/run_program.h"
#include "support/temp_dir.h"

namespace s3lam::testing {

constexpr int kDone = 0;
constexpr int kFailed = 1;
constexpr int kWrongUsage = 2;
constexpr int kBadInput = 3;

inline const std::filesystem::path kClasses =
    std::filesystem::path(S3LAM_TEST_SOURCE_DIR) / "configs" / "classes";

/// Runs one of the project's programs as a user does, with warnings and errors only on stderr.
inline ProgramResult RunTool(const std::string& name, const std::vector<std::string>& arguments) {
  std::vector<std::string> words = {(std::filesystem::path(S3LAM_TEST_BIN_DIR) / name).string(),
                                    "--quiet"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  return RunProgramApart(words);
}

/// The program ended with `exit_code`, said nothing on stdout, and one line on stderr that has all
/// of `parts`: the file and the reason.
inline void ExpectRefused(const ProgramResult& result, int exit_code,
                          const std::vector<std::string>& parts) {
  EXPECT_EQ(result.exit_code, exit_code) << result.errors;
  EXPECT_EQ(result.output, "");
  EXPECT_EQ(std::count(result.errors.begin(), result.errors.end(), '\n'), 1) << result.errors;
  EXPECT_THAT(result.errors, ::testing::StartsWith("s3-"));
  for (const std::string& part : parts) EXPECT_THAT(result.errors, ::testing::HasSubstr(part));
}

/// Names of what a folder holds, hidden files included, sorted.
inline std::vector<std::string> Listing(const std::filesystem::path& directory) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(directory)) {
    names.push_back(entry.path().filename().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

/// Arguments are refused, and nothing is left where the output would have been.
class RefusedTest : public ::testing::Test {
 protected:
  /// Where outputs go: a folder of its own, so that leftovers are seen.
  [[nodiscard]] std::filesystem::path output() const { return outputs_ / "out"; }

  void ExpectRefusedWithoutTrace(const std::string& program, std::vector<std::string> arguments,
                                 int exit_code, const std::vector<std::string>& parts) {
    arguments.insert(arguments.end(), {"--output", output().string()});
    ExpectRefused(RunTool(program, arguments), exit_code, parts);
    EXPECT_THAT(Listing(outputs_.path()), ::testing::IsEmpty());
  }

 private:
  TempDir outputs_;
};

}  // namespace s3lam::testing
