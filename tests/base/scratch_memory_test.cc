#include "s3lam/base/scratch_memory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <utility>

#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::TempDir;
using ::testing::ThrowsMessage;

constexpr uint64_t kBytes = 10 << 20;

/// Sets TMPDIR for as long as it lives.
class TemporaryDirectory {
 public:
  explicit TemporaryDirectory(const std::filesystem::path& path) {
    if (const char* before = std::getenv("TMPDIR")) before_ = before;
    setenv("TMPDIR", path.c_str(), 1);
  }
  ~TemporaryDirectory() {
    if (before_.empty()) {
      unsetenv("TMPDIR");
    } else {
      setenv("TMPDIR", before_.c_str(), 1);
    }
  }

 private:
  std::string before_;
};

void ExpectUsable(const ScratchMemory& memory) {
  EXPECT_EQ(memory.data()[0], std::byte{0});
  EXPECT_EQ(memory.data()[kBytes - 1], std::byte{0});
  memory.data()[0] = std::byte{7};
  memory.data()[kBytes - 1] = std::byte{9};
  EXPECT_EQ(memory.data()[0], std::byte{7});
  EXPECT_EQ(memory.data()[kBytes - 1], std::byte{9});
}

TEST(ScratchMemory, IsMemoryWhereThatLeavesEnough) {
  const ScratchMemory memory(kBytes, "test", 2 * kBytes);
  EXPECT_FALSE(memory.IsFile());
  ExpectUsable(memory);
}

TEST(ScratchMemory, IsElseAFileThatNobodySees) {
  const TempDir dir;
  const TemporaryDirectory environment(dir.path());
  const ScratchMemory memory(kBytes, "test", kBytes);
  EXPECT_TRUE(memory.IsFile());
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
  ExpectUsable(memory);
}

TEST(ScratchMemory, CanBeMovedAndBeNone) {
  ScratchMemory memory(kBytes, "test", 2 * kBytes);
  memory.data()[5] = std::byte{3};
  ScratchMemory other;
  EXPECT_EQ(other.data(), nullptr);
  other = std::move(memory);
  EXPECT_EQ(other.data()[5], std::byte{3});
  EXPECT_EQ(ScratchMemory(0, "test").data(), nullptr);
}

TEST(ScratchMemory, SaysWhatHasNoRoomAndWhere) {
  const TempDir dir;
  const TemporaryDirectory environment(dir.path());
  constexpr uint64_t kTooLarge = std::numeric_limits<int64_t>::max() / 2;
  EXPECT_THAT([] { ScratchMemory(kTooLarge, "many images", kBytes); },
              ThrowsMessage<std::runtime_error>(AllOf(HasSubstr("many images"),
                                                      HasSubstr("10 MiB of memory"),
                                                      HasSubstr(dir.path().string()))));
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
}

}  // namespace
}  // namespace s3lam
