#include "s3lam/base/output_directory.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>
#include <system_error>

#include "s3lam/base/error.h"

namespace s3lam {
namespace fs = std::filesystem;
namespace {

void SyncPath(const fs::path& path, int flags) {
  const int fd = open(path.c_str(), flags | O_CLOEXEC);
  const bool synced = fd >= 0 && fsync(fd) == 0;
  const int error = errno;
  if (fd >= 0) close(fd);
  if (!synced) {
    throw std::runtime_error(
        fmt::format("{}: cannot flush to disk: {}", path.string(), std::strerror(error)));
  }
}

void SyncTree(const fs::path& root) {
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root)) {
    SyncPath(entry.path(), entry.is_directory() ? O_RDONLY | O_DIRECTORY : O_RDONLY);
  }
  SyncPath(root, O_RDONLY | O_DIRECTORY);
}

fs::path ParentOf(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

}  // namespace

OutputDirectory::OutputDirectory(fs::path target, bool overwrite)
    : target_(std::move(target)), overwrite_(overwrite) {
  if (!target_.has_filename()) target_ = target_.parent_path();  // "dir/" names "dir".
  if (target_.empty()) throw InputError("output directory: empty path");
  const fs::file_status status = fs::symlink_status(target_);
  if (fs::exists(status)) {
    if (!fs::is_directory(status)) {
      ThrowInputError("{}: output exists and is not a directory", target_.string());
    }
    if (!overwrite) {
      ThrowInputError("{}: output directory exists; give --overwrite to replace it",
                      target_.string());
    }
  }
  std::error_code error;
  fs::create_directories(ParentOf(target_), error);
  if (error) {
    ThrowInputError("{}: cannot create: {}", ParentOf(target_).string(), error.message());
  }
  std::string name =
      fmt::format("{}/.{}.tmp-XXXXXX", ParentOf(target_).string(), target_.filename().string());
  if (mkdtemp(name.data()) == nullptr) {
    ThrowInputError("{}: cannot write here: {}", ParentOf(target_).string(), std::strerror(errno));
  }
  staging_ = name;
  const mode_t mask = umask(0);
  umask(mask);
  chmod(staging_.c_str(), 0777 & ~mask);  // mkdtemp makes it private; a result is not.
}

OutputDirectory::~OutputDirectory() {
  if (committed_) return;
  std::error_code ignored;
  fs::remove_all(staging_, ignored);
}

void OutputDirectory::Commit() {
  S3LAM_CHECK(!committed_);
  SyncTree(staging_);
  const bool replaces = overwrite_ && fs::exists(target_);
  const unsigned int flags = replaces ? RENAME_EXCHANGE : RENAME_NOREPLACE;
  if (renameat2(AT_FDCWD, staging_.c_str(), AT_FDCWD, target_.c_str(), flags) != 0) {
    throw std::runtime_error(fmt::format("{}: cannot put the result in place: {}", target_.string(),
                                         std::strerror(errno)));
  }
  committed_ = true;
  SyncPath(ParentOf(target_), O_RDONLY | O_DIRECTORY);
  if (replaces) {  // After the exchange the staging name holds the old result.
    std::error_code ignored;
    fs::remove_all(staging_, ignored);
  }
}

}  // namespace s3lam
