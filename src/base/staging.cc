#include "staging.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <set>
#include <string>
#include <system_error>

#include "s3lam/base/error.h"
#include "s3lam/base/output_directory.h"

namespace s3lam {
namespace fs = std::filesystem;
namespace {

constexpr const char* kAside = ".old";

/// What to remove if the program is ended from outside. The mutex is also what a commit takes place
/// under.
std::mutex g_mutex;
std::set<fs::path> g_uncommitted;  // NOLINT: empty at start and at the end.

/// mkstemp and mkdtemp make names of these.
bool IsOfMkstemp(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0; }

/// Names of what runs with this target write into end in six characters of mkstemp's.
std::string StagingPrefix(const fs::path& target) {
  return fmt::format(".{}.tmp-", target.filename().string());
}

/// The open and locked folder or file, or -1 if another process has it (or it cannot be locked).
int OpenLocked(const fs::path& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) == 0) return fd;
  if (fd >= 0) close(fd);
  return -1;
}

/// Is this name in the target's folder one of Staging's, or of what it has put aside?
bool IsLeftover(const std::string& name, const fs::path& target) {
  constexpr size_t kNumRandom = 6;
  const std::string prefix = StagingPrefix(target);
  if (!name.starts_with(prefix)) return false;
  const size_t length = name.size() - prefix.size();
  const std::string random = name.substr(prefix.size(), kNumRandom);
  if (!std::all_of(random.begin(), random.end(), IsOfMkstemp)) return false;
  if (length == kNumRandom) return true;
  // Between the steps of a replacement, what is aside is the only result that there is.
  std::error_code ignored;
  return length == kNumRandom + std::strlen(kAside) && name.ends_with(kAside) &&
         fs::exists(target, ignored);
}

/// Removes what runs which were killed have left beside the target, folders for a folder.
void RemoveLeftovers(const fs::path& target, internal::Staging::Kind kind) {
  std::error_code ignored;  // What cannot be removed disturbs nobody.
  std::vector<fs::path> leftovers;
  for (fs::directory_iterator it(internal::ParentOf(target), ignored), end; !ignored && it != end;
       it.increment(ignored)) {
    const bool is_folder = it->is_directory(ignored);
    if (is_folder != (kind == internal::Staging::Kind::kFolder)) continue;
    if (IsLeftover(it->path().filename().string(), target)) leftovers.push_back(it->path());
  }
  for (const fs::path& path : leftovers) {
    const int fd = OpenLocked(path);
    if (fd < 0) continue;
    fs::remove_all(path, ignored);
    close(fd);
  }
}

/// True if `path` still names what is open as `fd`.
bool IsStillThere(const fs::path& path, int fd) {
  struct stat by_name {};
  struct stat by_fd {};
  return stat(path.c_str(), &by_name) == 0 && fstat(fd, &by_fd) == 0 &&
         by_name.st_ino == by_fd.st_ino && by_name.st_dev == by_fd.st_dev;
}

/// As new folders and files are; what mkdtemp and mkstemp make is private.
void GiveUsualPermissions(const fs::path& path, internal::Staging::Kind kind) {
  const mode_t usual = kind == internal::Staging::Kind::kFolder ? 0777 : 0666;
  const mode_t mask = umask(0);
  umask(mask);
  chmod(path.c_str(), usual & ~mask);
}

}  // namespace

namespace internal {

fs::path ParentOf(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

Staging::Staging(const fs::path& target, Kind kind) {
  std::error_code error;
  fs::create_directories(ParentOf(target), error);
  if (error) {
    ThrowInputError("{}: cannot create: {}", ParentOf(target).string(), error.message());
  }
  RemoveLeftovers(target, kind);
  Make(target, kind);
  GiveUsualPermissions(path_, kind);
}

void Staging::Make(const fs::path& target, Kind kind) {
  const std::lock_guard lock(g_mutex);
  const std::string pattern =
      fmt::format("{}/{}XXXXXX", ParentOf(target).string(), StagingPrefix(target));
  // Between making and locking it another run may take it for a leftover.
  constexpr int kMaxTries = 100;
  for (int i = 0; i < kMaxTries; ++i) {
    Close();
    std::string name = pattern;
    if (kind == Kind::kFile) fd_ = mkostemp(name.data(), O_CLOEXEC);
    if (kind == Kind::kFile ? fd_ < 0 : mkdtemp(name.data()) == nullptr) {
      ThrowInputError("{}: cannot write here: {}", ParentOf(target).string(), std::strerror(errno));
    }
    path_ = name;
    // Without a lock (a file system that has none) nobody else gets one either.
    if (kind == Kind::kFile && flock(fd_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) continue;
    if (kind == Kind::kFolder) fd_ = OpenLocked(path_);
    if (fd_ < 0 ? fs::exists(path_) : IsStillThere(path_, fd_)) break;
  }
  Register(path_);
}

void Staging::Close() {
  if (fd_ >= 0) close(fd_);
  fd_ = -1;
}

void Staging::Register(const fs::path& name) {
  names_.push_back(name);
  g_uncommitted.insert(name);
}

void Staging::Remove() {
  std::error_code ignored;
  for (const fs::path& name : names_) fs::remove_all(name, ignored);
  Close();
  const std::lock_guard lock(g_mutex);
  for (const fs::path& name : names_) g_uncommitted.erase(name);
  names_.clear();
}

std::unique_lock<std::mutex> Staging::LockCommits() { return std::unique_lock(g_mutex); }

bool Staging::ReplaceInTwoSteps(const fs::path& target) {
  const fs::path aside = path_.string() + kAside;
  if (rename(target.c_str(), aside.c_str()) != 0) return false;
  if (rename(path_.c_str(), target.c_str()) != 0) {
    const int error = errno;
    rename(aside.c_str(), target.c_str());
    errno = error;
    return false;
  }
  Register(aside);
  return true;
}

}  // namespace internal

void AbandonOutputs() {
  static std::unique_lock<std::mutex> never_released(g_mutex);  // NOLINT: held on purpose.
  constexpr int kMaxTries = 100;  // Other threads may be adding files.
  for (const fs::path& path : g_uncommitted) {
    std::error_code ignored;
    for (int i = 0; i < kMaxTries && fs::exists(path, ignored); ++i) fs::remove_all(path, ignored);
  }
}

}  // namespace s3lam
