#include "s3lam/base/output_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "s3lam/base/error.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

namespace fs = std::filesystem;
using testing::FileBytes;
using ::testing::HasSubstr;
using testing::TempDir;
using ::testing::ThrowsMessage;

size_t NumEntries(const fs::path& directory) {
  return static_cast<size_t>(
      std::distance(fs::directory_iterator(directory), fs::directory_iterator()));
}

TEST(OutputFile, AppearsOnlyWhenCommitted) {
  const TempDir dir;
  const std::string content("a\0b\r\n\xff", 6);
  OutputFile file(dir / "deep/er/report.html", false);
  EXPECT_FALSE(fs::exists(dir / "deep/er/report.html"));
  file.Commit(content);
  EXPECT_EQ(FileBytes(dir / "deep/er/report.html"), content);
  EXPECT_EQ(NumEntries(dir / "deep/er"), 1u);  // Nothing else is left beside it.
}

TEST(OutputFile, IsWrittenInPieces) {
  const TempDir dir;
  OutputFile file(dir / "state", false);
  file.Write("first, ");
  file.Write("second, ");
  file.Commit("last");
  EXPECT_EQ(FileBytes(dir / "state"), "first, second, last");
}

TEST(OutputFile, LeavesNothingWithoutCommit) {
  const TempDir dir;
  { const OutputFile file(dir / "report.html", false); }
  EXPECT_EQ(NumEntries(dir.path()), 0u);
}

TEST(OutputFile, ExistingTargetNeedsOverwrite) {
  const TempDir dir;
  dir.Write("report.html", "old");
  EXPECT_THAT([&] { OutputFile(dir / "report.html", false); },
              ThrowsMessage<InputError>(HasSubstr("--overwrite")));
  EXPECT_EQ(NumEntries(dir.path()), 1u);
  OutputFile file(dir / "report.html", true);
  EXPECT_EQ(FileBytes(dir / "report.html"), "old");
  file.Commit("new");
  EXPECT_EQ(FileBytes(dir / "report.html"), "new");
}

TEST(OutputFile, TargetThatAppearsMeanwhileIsKept) {
  const TempDir dir;
  {
    OutputFile file(dir / "report.html", false);
    dir.Write("report.html", "another's");
    EXPECT_THAT([&] { file.Commit("new"); },
                ThrowsMessage<std::runtime_error>(HasSubstr("report.html")));
  }
  EXPECT_EQ(FileBytes(dir / "report.html"), "another's");
  EXPECT_EQ(NumEntries(dir.path()), 1u);
}

TEST(OutputFile, RemovesWhatKilledRunsHaveLeftAndNotWhatOthersWrite) {
  const TempDir dir;
  dir.Write(".report.html.tmp-abcdef", "unfinished");
  OutputFile first(dir / "report.html", true);
  EXPECT_EQ(NumEntries(dir.path()), 1u);
  OutputFile second(dir / "report.html", true);
  EXPECT_EQ(NumEntries(dir.path()), 2u);
  first.Commit("first");
  second.Commit("second");
  EXPECT_EQ(FileBytes(dir / "report.html"), "second");
  EXPECT_EQ(NumEntries(dir.path()), 1u);
}

TEST(OutputFile, FolderIsRefused) {
  const TempDir dir;
  fs::create_directory(dir / "folder");
  EXPECT_THAT([&] { OutputFile(dir / "folder", true); },
              ThrowsMessage<InputError>(HasSubstr("directory")));
  EXPECT_THROW(OutputFile(dir / "folder/", true), InputError);
  EXPECT_THROW(OutputFile("", true), InputError);
}

}  // namespace
}  // namespace s3lam
