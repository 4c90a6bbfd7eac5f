#include "s3lam/base/output_directory.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

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

/// The folders to remove if the program is ended from outside. The mutex is also what a commit
/// takes place under.
std::mutex g_mutex;
std::set<fs::path> g_uncommitted;  // NOLINT: empty at start and at the end.

/// Names of the folders that runs with this target write into end in six characters of mkdtemp's.
std::string StagingPrefix(const fs::path& target) {
  return fmt::format(".{}.tmp-", target.filename().string());
}

/// The open and locked folder, or -1 if another process has it (or it cannot be locked).
int LockFolder(const fs::path& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
  if (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) == 0) return fd;
  if (fd >= 0) close(fd);
  return -1;
}

/// Removes the folders that runs which were killed have left beside the target.
void RemoveLeftovers(const fs::path& target) {
  constexpr size_t kNumRandom = 6;
  const std::string prefix = StagingPrefix(target);
  std::error_code ignored;  // What cannot be removed disturbs nobody.
  std::vector<fs::path> leftovers;
  for (fs::directory_iterator it(ParentOf(target), ignored), end; !ignored && it != end;
       it.increment(ignored)) {
    const std::string name = it->path().filename().string();
    if (name.size() == prefix.size() + kNumRandom && name.starts_with(prefix)) {
      leftovers.push_back(it->path());
    }
  }
  for (const fs::path& path : leftovers) {
    const int fd = LockFolder(path);
    if (fd < 0) continue;
    fs::remove_all(path, ignored);
    close(fd);
  }
}

/// True if `path` still names the folder that is open as `fd`.
bool IsStillThere(const fs::path& path, int fd) {
  struct stat by_name {};
  struct stat by_fd {};
  return stat(path.c_str(), &by_name) == 0 && fstat(fd, &by_fd) == 0 &&
         by_name.st_ino == by_fd.st_ino && by_name.st_dev == by_fd.st_dev;
}

/// Moves the old target aside and `staging` to its place, where the file system cannot exchange the
/// two. Returns false with errno set and the old target in place if that fails.
bool ReplaceInTwoSteps(const fs::path& staging, const fs::path& target) {
  const fs::path aside = staging.string() + ".old";
  if (rename(target.c_str(), aside.c_str()) != 0) return false;
  if (rename(staging.c_str(), target.c_str()) != 0) {
    const int error = errno;
    rename(aside.c_str(), target.c_str());
    errno = error;
    return false;
  }
  return rename(aside.c_str(), staging.c_str()) == 0;  // As after an exchange.
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
  fs::create_directories(ParentOf(target_), error);
  if (error) {
    ThrowInputError("{}: cannot create: {}", ParentOf(target_).string(), error.message());
  }
  RemoveLeftovers(target_);
  CreateStaging();
  const mode_t mask = umask(0);
  umask(mask);
  chmod(staging_.c_str(), 0777 & ~mask);  // mkdtemp makes it private; a result is not.
}

void OutputDirectory::CreateStaging() {
  const std::lock_guard lock(g_mutex);
  const std::string pattern =
      fmt::format("{}/{}XXXXXX", ParentOf(target_).string(), StagingPrefix(target_));
  // Between making and locking it another run may take it for a leftover.
  constexpr int kMaxTries = 100;
  for (int i = 0; i < kMaxTries; ++i) {
    std::string name = pattern;
    if (mkdtemp(name.data()) == nullptr) {
      ThrowInputError("{}: cannot write here: {}", ParentOf(target_).string(),
                      std::strerror(errno));
    }
    staging_ = name;
    lock_fd_ = LockFolder(staging_);
    // Without a lock (a file system that has none) nobody else gets one either.
    if (lock_fd_ < 0 ? fs::exists(staging_) : IsStillThere(staging_, lock_fd_)) break;
    Unlock();
  }
  g_uncommitted.insert(staging_);
}

void OutputDirectory::Unlock() {
  if (lock_fd_ >= 0) close(lock_fd_);
  lock_fd_ = -1;
}

OutputDirectory::~OutputDirectory() {
  RemoveStaging();
  Unlock();
  const std::lock_guard lock(g_mutex);
  g_uncommitted.erase(staging_);
}

void OutputDirectory::PutInPlace() {
  const bool replaces = overwrite_ && fs::exists(target_);
  const unsigned int flags = replaces ? RENAME_EXCHANGE : RENAME_NOREPLACE;
  bool done = renameat2(AT_FDCWD, staging_.c_str(), AT_FDCWD, target_.c_str(), flags) == 0;
  if (!done && (errno == EINVAL || errno == ENOSYS)) {  // Network file systems, some FUSE ones.
    // Plain rename() does not replace a folder that has anything in it.
    done = replaces ? ReplaceInTwoSteps(staging_, target_)
                    : rename(staging_.c_str(), target_.c_str()) == 0;
  }
  if (!done) {
    throw std::runtime_error(fmt::format("{}: cannot put the result in place: {}", target_.string(),
                                         std::strerror(errno)));
  }
}

void OutputDirectory::Commit() {
  S3LAM_CHECK(!committed_);
  SyncTree(staging_);
  {
    const std::lock_guard lock(g_mutex);
    PutInPlace();
    committed_ = true;
  }
  Unlock();  // The lock has gone with the folder to its new place.
  SyncPath(ParentOf(target_), O_RDONLY | O_DIRECTORY);
  RemoveStaging();
}

void OutputDirectory::RemoveStaging() const {
  std::error_code ignored;
  fs::remove_all(staging_, ignored);  // After an exchange the name holds the old result.
}

void AbandonOutputs() {
  static std::unique_lock<std::mutex> never_released(g_mutex);  // NOLINT: held on purpose.
  constexpr int kMaxTries = 100;  // Other threads may be adding files.
  for (const fs::path& path : g_uncommitted) {
    std::error_code ignored;
    for (int i = 0; i < kMaxTries && fs::exists(path, ignored); ++i) fs::remove_all(path, ignored);
  }
}

}  // namespace s3lam
