#pragma once

#include <filesystem>
#include <memory>
#include <string_view>

namespace s3lam {
namespace internal {
class Staging;
}

/// A result file that appears whole or not at all: written into a hidden file beside the target,
/// flushed to disk and renamed into place by Commit(). Without Commit() nothing is left; what a run
/// that was killed has left is removed by the next one with that target.
class OutputFile {
 public:
  /// Throws InputError if `target` exists and `overwrite` is false, if it is a folder, or if the
  /// place beside it cannot be written to.
  OutputFile(std::filesystem::path target, bool overwrite);
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  /// Appends to what is written so far. Throws std::runtime_error naming the file if that fails.
  void Write(std::string_view content);
  /// Appends what is left to write, flushes and renames. Throws std::runtime_error naming the file
  /// if that fails, or if a target has appeared meanwhile that must not be replaced.
  void Commit(std::string_view rest = {});

 private:
  /// What went wrong, by errno.
  [[noreturn]] void Fail(const char* what) const;
  /// Returns false with errno set if that fails.
  [[nodiscard]] bool PutInPlace() const;

  std::filesystem::path target_;
  std::unique_ptr<internal::Staging> staging_;
  bool overwrite_;
  bool committed_ = false;
};

}  // namespace s3lam
