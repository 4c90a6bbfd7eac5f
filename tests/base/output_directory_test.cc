#include "s3lam/base/output_directory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>

#include "s3lam/base/error.h"
#include "support/temp_dir.h"

namespace {

/// As on file systems that know no flags of renameat2: it refuses them.
bool g_has_rename_flags = true;  // NOLINT: set by tests.

}  // namespace

/// In place of the C library's.
extern "C" int renameat2(int from_fd, const char* from, int to_fd, const char* to,
                         unsigned int flags) noexcept {
  if (g_has_rename_flags || flags == 0) {
    return static_cast<int>(syscall(SYS_renameat2, from_fd, from, to_fd, to, flags));
  }
  errno = EINVAL;
  return -1;
}

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

void WriteText(const fs::path& path, const std::string& text) { std::ofstream(path) << text; }

TEST(OutputDirectory, AppearsOnlyWhenCommitted) {
  const TempDir dir;
  OutputDirectory output(dir / "deep/er/result", false);
  WriteText(output.path() / "a.txt", "new");
  EXPECT_FALSE(fs::exists(output.target()));
  output.Commit();
  EXPECT_EQ(FileBytes(dir / "deep/er/result/a.txt"), "new");
  EXPECT_EQ(NumEntries(dir / "deep/er"), 1u);  // Nothing else is left beside it.
}

TEST(OutputDirectory, LeavesNothingWithoutCommit) {
  const TempDir dir;
  {
    OutputDirectory output(dir / "result", false);
    WriteText(output.path() / "a.txt", "new");
    fs::create_directory(output.path() / "sub");
  }
  EXPECT_EQ(NumEntries(dir.path()), 0u);
}

TEST(OutputDirectory, ExistingTargetNeedsOverwrite) {
  const TempDir dir;
  dir.Write("result/old.txt", "old");
  EXPECT_THAT([&] { OutputDirectory(dir / "result", false); },
              ThrowsMessage<InputError>(HasSubstr("--overwrite")));
  EXPECT_THROW(OutputDirectory(dir / "result/", false), InputError);
  EXPECT_EQ(NumEntries(dir.path()), 1u);
  {
    OutputDirectory output(dir / "result", true);
    WriteText(output.path() / "new.txt", "new");
    EXPECT_TRUE(fs::exists(dir / "result/old.txt"));  // Still the old result.
  }
  EXPECT_EQ(FileBytes(dir / "result/old.txt"), "old");
  OutputDirectory output(dir / "result/", true);
  WriteText(output.path() / "new.txt", "new");
  output.Commit();
  EXPECT_EQ(NumEntries(dir / "result"), 1u);
  EXPECT_EQ(FileBytes(dir / "result/new.txt"), "new");
  EXPECT_EQ(NumEntries(dir.path()), 1u);
}

TEST(OutputDirectory, FilesAndBadPathsAreRefused) {
  const TempDir dir;
  const fs::path file = dir.Write("file", "x");
  EXPECT_THAT([&] { OutputDirectory(file, true); },
              ThrowsMessage<InputError>(HasSubstr("not a directory")));
  EXPECT_THROW(OutputDirectory(file / "below", true), InputError);
  EXPECT_THROW(OutputDirectory("", true), InputError);
  EXPECT_EQ(FileBytes(file), "x");
}

TEST(OutputDirectory, ReadOnlyParentIsRefused) {
  if (geteuid() == 0) GTEST_SKIP() << "root writes everywhere";
  const TempDir dir;
  fs::create_directory(dir / "locked");
  chmod((dir / "locked").c_str(), 0500);
  EXPECT_THAT([&] { OutputDirectory(dir / "locked/result", false); },
              ThrowsMessage<InputError>(HasSubstr("cannot write")));
  chmod((dir / "locked").c_str(), 0700);
}

TEST(OutputDirectory, ATargetThatAppearsMeanwhileIsKept) {
  const TempDir dir;
  OutputDirectory output(dir / "result", false);
  WriteText(output.path() / "new.txt", "new");
  dir.Write("result/other.txt", "other");
  EXPECT_ANY_THROW(output.Commit());
  EXPECT_EQ(FileBytes(dir / "result/other.txt"), "other");
}

TEST(OutputDirectory, ReplacesInTwoStepsWhereFoldersCannotBeExchanged) {
  const TempDir dir;
  dir.Write("result/old.txt", "old");
  OutputDirectory output(dir / "result", true);
  WriteText(output.path() / "new.txt", "new");
  g_has_rename_flags = false;
  output.Commit();
  g_has_rename_flags = true;
  EXPECT_EQ(FileBytes(dir / "result/new.txt"), "new");
  EXPECT_FALSE(fs::exists(dir / "result/old.txt"));
  EXPECT_EQ(NumEntries(dir.path()), 1u);
}

TEST(OutputDirectory, RemovesWhatKilledRunsHaveLeft) {
  const TempDir dir;
  dir.Write("result/old.txt", "of the last run");
  dir.Write(".result.tmp-abcdef/new.txt", "unfinished");
  dir.Write(".result.tmp-abcdeg.old/old.txt", "replaced");
  dir.Write(".result.tmp-abcdef.kept/file.txt", "of somebody else");
  dir.Write(".results.tmp-abcdef/file.txt", "of another target");
  { const OutputDirectory output(dir / "result", true); }
  EXPECT_TRUE(fs::exists(dir / "result/old.txt"));
  EXPECT_TRUE(fs::exists(dir / ".result.tmp-abcdef.kept"));
  EXPECT_TRUE(fs::exists(dir / ".results.tmp-abcdef"));
  EXPECT_EQ(NumEntries(dir.path()), 3u);
}

TEST(OutputDirectory, KeepsTheOldResultOfARunKilledBetweenTheTwoSteps) {
  const TempDir dir;
  dir.Write(".result.tmp-abcdef.old/old.txt", "the only one");
  { const OutputDirectory output(dir / "result", true); }
  EXPECT_EQ(FileBytes(dir / ".result.tmp-abcdef.old/old.txt"), "the only one");
}

TEST(OutputDirectory, ResultHasTheUsualPermissions) {
  const TempDir dir;
  const mode_t mask = umask(022);
  OutputDirectory output(dir / "result", false);
  output.Commit();
  umask(mask);
  const auto permissions = fs::status(dir / "result").permissions() & fs::perms::mask;
  EXPECT_EQ(static_cast<unsigned>(permissions), 0755u);
}

}  // namespace
}  // namespace s3lam
