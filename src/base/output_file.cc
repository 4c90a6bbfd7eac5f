#include "s3lam/base/output_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>

#include "s3lam/base/error.h"
#include "staging.h"

namespace s3lam {
namespace fs = std::filesystem;
using internal::Staging;

OutputFile::OutputFile(fs::path target, bool overwrite)
    : target_(std::move(target)), overwrite_(overwrite) {
  if (!target_.has_filename()) ThrowInputError("{}: not the name of a file", target_.string());
  const fs::file_status status = fs::symlink_status(target_);
  if (fs::is_directory(status)) ThrowInputError("{}: output is a directory", target_.string());
  if (fs::exists(status) && !overwrite) {
    ThrowInputError("{}: output exists; give --overwrite to replace it", target_.string());
  }
  staging_ = std::make_unique<Staging>(target_, Staging::Kind::kFile);
}

OutputFile::~OutputFile() = default;

bool OutputFile::PutInPlace() const {
  const char* from = staging_->path().c_str();
  const unsigned int flags = overwrite_ ? 0 : RENAME_NOREPLACE;
  if (renameat2(AT_FDCWD, from, AT_FDCWD, target_.c_str(), flags) == 0) return true;
  if (errno != EINVAL && errno != ENOSYS) return false;  // Network file systems, some FUSE ones.
  return overwrite_ ? rename(from, target_.c_str()) == 0
                    : link(from, target_.c_str()) == 0 && unlink(from) == 0;
}

void OutputFile::Fail(const char* what) const {
  throw std::runtime_error(fmt::format("{}: {}: {}", target_.string(), what, std::strerror(errno)));
}

void OutputFile::Write(std::string_view content) {
  S3LAM_CHECK(!committed_);
  while (!content.empty()) {
    const ssize_t written = write(staging_->fd(), content.data(), content.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) Fail("cannot write");
    content.remove_prefix(static_cast<size_t>(written));
  }
}

void OutputFile::Commit(std::string_view rest) {
  Write(rest);
  if (fsync(staging_->fd()) != 0) Fail("cannot flush to disk");
  {
    const auto lock = Staging::LockCommits();
    if (!PutInPlace()) Fail("cannot put the result in place");
    committed_ = true;
  }
  const int parent = open(internal::ParentOf(target_).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const bool synced = parent >= 0 && fsync(parent) == 0;
  if (parent >= 0) close(parent);
  if (!synced) Fail("cannot flush its folder to disk");
}

}  // namespace s3lam
