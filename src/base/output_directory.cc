#include "s3lam/base/output_directory.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>
#include <system_error>

#include "s3lam/base/error.h"
#include "staging.h"

namespace s3lam {
namespace fs = std::filesystem;
using internal::Staging;
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

}  // namespace

OutputDirectory::OutputDirectory(fs::path target, bool overwrite)
    : target_(std::move(target)), overwrite_(overwrite) {
  if (!target_.has_filename()) target_ = target_.parent_path();  // "dir/" names "dir".
  if (target_.empty()) throw InputError("output directory: empty path");
  std::error_code error;
  const fs::file_status status = fs::symlink_status(target_, error);
  if (fs::exists(status)) {
    if (!fs::is_directory(status)) {
      ThrowInputError("{}: output exists and is not a directory", target_.string());
    }
    if (!overwrite) {
      ThrowInputError("{}: output directory exists; give --overwrite to replace it",
                      target_.string());
    }
  }
  staging_ = std::make_unique<Staging>(target_, Staging::Kind::kFolder);
}

OutputDirectory::~OutputDirectory() = default;

const fs::path& OutputDirectory::path() const { return staging_->path(); }

void OutputDirectory::PutInPlace() {
  const bool replaces = overwrite_ && fs::exists(target_);
  const unsigned int flags = replaces ? RENAME_EXCHANGE : RENAME_NOREPLACE;
  bool done = renameat2(AT_FDCWD, path().c_str(), AT_FDCWD, target_.c_str(), flags) == 0;
  if (!done && (errno == EINVAL || errno == ENOSYS)) {  // Network file systems, some FUSE ones.
    // Plain rename() does not replace a folder that has anything in it.
    done = replaces ? staging_->ReplaceInTwoSteps(target_)
                    : rename(path().c_str(), target_.c_str()) == 0;
  }
  if (!done) {
    throw std::runtime_error(fmt::format("{}: cannot put the result in place: {}", target_.string(),
                                         std::strerror(errno)));
  }
}

void OutputDirectory::Commit() {
  S3LAM_CHECK(!committed_);
  SyncTree(path());
  {
    const auto lock = Staging::LockCommits();
    PutInPlace();
    committed_ = true;
  }
  SyncPath(internal::ParentOf(target_), O_RDONLY | O_DIRECTORY);
  staging_->Remove();  // After an exchange the name holds the old result.
}

}  // namespace s3lam
