#pragma once

#include <filesystem>

namespace s3lam {

/// A result folder that appears whole or not at all. Files are written into path(), a hidden folder
/// beside the target; Commit() flushes them to disk and renames the folder into place, exchanging
/// it atomically with an existing target. Without Commit() everything written is removed.
class OutputDirectory {
 public:
  /// Throws InputError if `target` exists and `overwrite` is false, if it is not a folder, or if
  /// the place beside it cannot be written to.
  OutputDirectory(std::filesystem::path target, bool overwrite);
  ~OutputDirectory();
  OutputDirectory(const OutputDirectory&) = delete;
  OutputDirectory& operator=(const OutputDirectory&) = delete;

  /// Where to write.
  [[nodiscard]] const std::filesystem::path& path() const { return staging_; }
  /// Where the result will be.
  [[nodiscard]] const std::filesystem::path& target() const { return target_; }

  /// Throws std::runtime_error naming the file if flushing or renaming fails, or if a target has
  /// appeared meanwhile that must not be replaced; what was there is then still in place.
  void Commit();

 private:
  std::filesystem::path target_;
  std::filesystem::path staging_;
  bool overwrite_;
  bool committed_ = false;
};

}  // namespace s3lam
