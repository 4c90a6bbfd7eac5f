#include "s3lam/base/output_file.h"

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

fs::path ParentOf(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

}  // namespace

OutputFile::OutputFile(fs::path target, bool overwrite)
    : target_(std::move(target)), overwrite_(overwrite) {
  if (!target_.has_filename()) ThrowInputError("{}: not the name of a file", target_.string());
  const fs::file_status status = fs::symlink_status(target_);
  if (fs::is_directory(status)) ThrowInputError("{}: output is a directory", target_.string());
  if (fs::exists(status) && !overwrite) {
    ThrowInputError("{}: output exists; give --overwrite to replace it", target_.string());
  }
  std::error_code error;
  fs::create_directories(ParentOf(target_), error);
  if (error) {
    ThrowInputError("{}: cannot create: {}", ParentOf(target_).string(), error.message());
  }
  std::string name =
      fmt::format("{}/.{}.tmp-XXXXXX", ParentOf(target_).string(), target_.filename().string());
  fd_ = mkostemp(name.data(), O_CLOEXEC);
  if (fd_ < 0) {
    ThrowInputError("{}: cannot write here: {}", ParentOf(target_).string(), std::strerror(errno));
  }
  staging_ = name;
  const mode_t mask = umask(0);
  umask(mask);
  fchmod(fd_, 0666 & ~mask);  // mkostemp makes it private; a result is not.
}

OutputFile::~OutputFile() {
  if (fd_ >= 0) close(fd_);
  std::error_code ignored;
  if (!staging_.empty()) fs::remove(staging_, ignored);
}

void OutputFile::Commit(std::string_view content) {
  S3LAM_CHECK(!staging_.empty());
  const auto fail = [&](const char* what) {
    throw std::runtime_error(
        fmt::format("{}: {}: {}", target_.string(), what, std::strerror(errno)));
  };
  while (!content.empty()) {
    const ssize_t written = write(fd_, content.data(), content.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) fail("cannot write");
    content.remove_prefix(static_cast<size_t>(written));
  }
  if (fsync(fd_) != 0) fail("cannot flush to disk");
  const unsigned int flags = overwrite_ ? 0 : RENAME_NOREPLACE;
  bool done = renameat2(AT_FDCWD, staging_.c_str(), AT_FDCWD, target_.c_str(), flags) == 0;
  if (!done && (errno == EINVAL || errno == ENOSYS)) {  // Network file systems, some FUSE ones.
    done = overwrite_
               ? rename(staging_.c_str(), target_.c_str()) == 0
               : link(staging_.c_str(), target_.c_str()) == 0 && unlink(staging_.c_str()) == 0;
  }
  if (!done) fail("cannot put the result in place");
  staging_.clear();
  const int parent = open(ParentOf(target_).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const bool synced = parent >= 0 && fsync(parent) == 0;
  if (parent >= 0) close(parent);
  if (!synced) fail("cannot flush its folder to disk");
}

}  // namespace s3lam
