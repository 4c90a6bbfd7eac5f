#pragma once

#include <filesystem>
#include <mutex>
#include <vector>

namespace s3lam::internal {

/// The folder that a path lies in; "." for a bare name.
std::filesystem::path ParentOf(const std::filesystem::path& path);

/// What is written beside a target until it is whole: a hidden folder or file named
/// ".<target>.tmp-XXXXXX". It is locked, so that nobody takes it for a leftover, and on the list of
/// what AbandonOutputs() removes.
class Staging {
 public:
  enum class Kind { kFolder, kFile };

  /// Removes what runs with this target that were killed have left, and makes the new one. Throws
  /// InputError if the place beside the target cannot be made, or written to.
  Staging(const std::filesystem::path& target, Kind kind);
  ~Staging() { Remove(); }
  Staging(const Staging&) = delete;
  Staging& operator=(const Staging&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  /// The open file, to be written to; of a folder, what holds the lock, or -1.
  [[nodiscard]] int fd() const { return fd_; }

  /// Held while a result is put in place; never to be had again once the program is being ended
  /// from outside.
  static std::unique_lock<std::mutex> LockCommits();
  /// Under that lock, where the file system cannot exchange two folders: moves the old target aside
  /// and this one to its place. Returns false with errno set and the old target in place if that
  /// fails.
  bool ReplaceInTwoSteps(const std::filesystem::path& target);
  /// Removes what has the name path() now, and what was moved aside, and unlocks.
  void Remove();

 private:
  void Make(const std::filesystem::path& target, Kind kind);
  void Close();
  void Register(const std::filesystem::path& name);

  std::filesystem::path path_;
  std::vector<std::filesystem::path> names_;  // To be removed.
  int fd_ = -1;
};

}  // namespace s3lam::internal
