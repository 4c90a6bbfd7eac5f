#pragma once

#include <filesystem>
#include <memory>

namespace s3lam {
namespace internal {
class Staging;
}

/// A result folder that appears whole or not at all. Files are written into path(), a hidden folder
/// beside the target; Commit() flushes them to disk and renames the folder into place, exchanging
/// it atomically with an existing target. Without Commit() everything written is removed. What a
/// run that was killed has left beside the target is removed by the next run with that target; the
/// folder of a run that is still going on is locked, and left alone.
class OutputDirectory {
 public:
  /// Throws InputError if `target` exists and `overwrite` is false, if it is not a folder, or if
  /// the place beside it cannot be written to.
  OutputDirectory(std::filesystem::path target, bool overwrite);
  ~OutputDirectory();
  OutputDirectory(const OutputDirectory&) = delete;
  OutputDirectory& operator=(const OutputDirectory&) = delete;

  /// Where to write.
  [[nodiscard]] const std::filesystem::path& path() const;
  /// Where the result will be.
  [[nodiscard]] const std::filesystem::path& target() const { return target_; }

  /// Throws std::runtime_error naming the file if flushing or renaming fails, or if a target has
  /// appeared meanwhile that must not be replaced; what was there is then still in place. File
  /// systems that cannot exchange two folders have the old one moved aside first.
  void Commit();

 private:
  void PutInPlace();

  std::filesystem::path target_;
  std::unique_ptr<internal::Staging> staging_;
  bool overwrite_;
  bool committed_ = false;
};

/// Removes folders and files that are not committed yet, and keeps any later Commit() from taking
/// place: the program is about to be ended from outside, while its other threads still run.
void AbandonOutputs();

}  // namespace s3lam
