// Output folders: the old one or the whole new one, whatever happens.

#include <sys/mount.h>

#include <cerrno>
#include <cstring>

#include "pipeline/model_fixture.h"

namespace s3lam {
namespace {

using testing::ExpectRefused;
using testing::FileBytes;
using testing::kBadInput;
using testing::kDone;
using testing::kFailed;
using testing::kWrongUsage;
using testing::Listing;
using testing::ProgramResult;
using testing::RunTool;
using testing::TempDir;

class Output : public testing::ModelTest {
 protected:
  [[nodiscard]] ProgramResult Lift(const std::filesystem::path& to,
                                   const std::vector<std::string>& more = {}) const {
    return Run("s3-lift", LiftArguments(), to, more);
  }
  [[nodiscard]] ProgramResult Refine(const std::filesystem::path& to,
                                     const std::vector<std::string>& more = {}) const {
    return Run("s3-refine", RefineArguments(), to, more);
  }
  TempDir place_;

 private:
  static ProgramResult Run(const std::string& program, std::vector<std::string> arguments,
                           const std::filesystem::path& to, const std::vector<std::string>& more) {
    arguments.insert(arguments.end(), {"--output", to.string()});
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunTool(program, arguments);
  }
};

TEST_F(Output, ExistingOneIsRefusedAndKept) {
  place_.Write("out/precious.txt", "keep me");
  ExpectRefused(Lift(place_ / "out"), kBadInput, {(place_ / "out").string(), "--overwrite"});
  ExpectRefused(Refine(place_ / "out"), kBadInput, {(place_ / "out").string(), "--overwrite"});
  EXPECT_EQ(FileBytes(place_ / "out" / "precious.txt"), "keep me");
  EXPECT_THAT(Listing(place_.path()), ::testing::ElementsAre("out"));
}

TEST_F(Output, OverwriteReplacesTheWholeFolder) {
  place_.Write("out/stale.txt", "of an earlier run");
  const ProgramResult result = Refine(place_ / "out", {"--overwrite"});
  ASSERT_EQ(result.exit_code, kDone) << result.errors;
  EXPECT_FALSE(std::filesystem::exists(place_ / "out" / "stale.txt"));
  EXPECT_TRUE(std::filesystem::exists(place_ / "out" / "cameras.bin"));
  EXPECT_THAT(Listing(place_.path()), ::testing::ElementsAre("out"));
}

TEST_F(Output, AnInputInItIsNotRemoved) {
  std::filesystem::create_directory(place_ / "out");
  std::filesystem::copy(model(), place_ / "out" / "model",
                        std::filesystem::copy_options::recursive);
  ExpectRefused(RunTool("s3-refine", {"--model", (place_ / "out" / "model").string(), "--output",
                                      (place_ / "out").string(), "--overwrite"}),
                kWrongUsage, {"would remove --model"});
  EXPECT_TRUE(std::filesystem::exists(place_ / "out" / "model" / "points3D.bin"));
}

TEST_F(Output, AnInputIsNotReplaced) {
  place_.Write("photos/1.png", "a photo");
  const std::string photos = (place_ / "photos").string();
  ExpectRefused(RunTool("s3-slam", {"--sequence", photos, "--output", photos + "/", "--overwrite"}),
                kWrongUsage, {"would remove --sequence"});
  ExpectRefused(RunTool("s3-slam", {"--sequence", "elsewhere", "--ignore-masks", photos, "--output",
                                    photos, "--overwrite"}),
                kWrongUsage, {"would remove --ignore-masks"});
  ExpectRefused(Refine(model(), {"--overwrite"}), kWrongUsage, {"would remove --model"});
  EXPECT_EQ(FileBytes(place_ / "photos/1.png"), "a photo");
  EXPECT_THAT(Listing(place_.path()), ::testing::ElementsAre("photos"));
}

TEST_F(Output, FailureKeepsTheOldOne) {
  place_.Write("out/old.txt", "old result");
  Truncate(model() / "images.bin", 0.5);
  EXPECT_EQ(Refine(place_ / "out", {"--overwrite"}).exit_code, kBadInput);
  EXPECT_EQ(Lift(place_ / "out", {"--overwrite"}).exit_code, kBadInput);
  EXPECT_EQ(FileBytes(place_ / "out" / "old.txt"), "old result");
  EXPECT_THAT(Listing(place_.path()), ::testing::ElementsAre("out"));
}

TEST_F(Output, AFileIsInTheWay) {
  place_.Write("out", "a file");
  ExpectRefused(Refine(place_ / "out", {"--overwrite"}), kBadInput, {(place_ / "out").string()});
  EXPECT_EQ(FileBytes(place_ / "out"), "a file");
}

// Permissions do not stop root, so the unwritable places are ones where nobody can write.
TEST_F(Output, PlaceThatCannotBeWrittenTo) {
  place_.Write("file", "");
  for (const std::filesystem::path& place :
       {place_ / "file" / "out", std::filesystem::path("/proc/out")}) {
    ExpectRefused(Lift(place), kBadInput, {place.parent_path().string()});
    ExpectRefused(Refine(place), kBadInput, {place.parent_path().string()});
  }
}

/// A file system that fills up after a few kilobytes.
class FullDisk : public Output {
 protected:
  void SetUp() override {
    if (mount("none", place_.path().c_str(), "tmpfs", 0, "size=64k") != 0) {
      GTEST_SKIP() << "cannot mount a small file system here: " << std::strerror(errno);
    }
    mounted_ = true;
  }
  void TearDown() override {
    if (mounted_) {
      EXPECT_EQ(umount(place_.path().c_str()), 0);
    }
  }

 private:
  bool mounted_ = false;
};

TEST_F(FullDisk, IsReportedAndLeavesNothing) {
  ExpectRefused(Lift(place_ / "out"), kFailed, {place_.path().string()});
  EXPECT_THAT(Listing(place_.path()), ::testing::IsEmpty());
  ExpectRefused(Refine(place_ / "out"), kFailed, {place_.path().string()});
  EXPECT_THAT(Listing(place_.path()), ::testing::IsEmpty());
}

// The same error path where nothing can be mounted: the kernel refuses to let a file grow.
TEST_F(Output, FileThatCannotGrowIsReportedAndLeavesNothing) {
  for (const std::string program : {"s3-lift", "s3-refine"}) {
    std::vector<std::string> words = {
        "bash",
        "-c",
        "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\"",
        (std::filesystem::path(S3LAM_TEST_BIN_DIR) / program).string(),
        "--quiet",
        "--output",
        (place_ / "out").string()};
    const auto arguments = program == "s3-lift" ? LiftArguments() : RefineArguments();
    words.insert(words.end(), arguments.begin(), arguments.end());
    ExpectRefused(testing::RunProgramApart(words), kFailed, {place_.path().string()});
    EXPECT_THAT(Listing(place_.path()), ::testing::IsEmpty());
  }
}

TEST_F(Output, ReportThatCannotBePrinted) {
  std::vector<std::string> words = {
      "bash",
      "-c",
      "exec \"$0\" \"$@\" > /dev/full",
      (std::filesystem::path(S3LAM_TEST_BIN_DIR) / "s3-refine").string(),
      "--quiet",
      "--output",
      (place_ / "out").string()};
  const auto arguments = RefineArguments();
  words.insert(words.end(), arguments.begin(), arguments.end());
  ExpectRefused(testing::RunProgramApart(words), kFailed, {"standard output"});
}

}  // namespace
}  // namespace s3lam
