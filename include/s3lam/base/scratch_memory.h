#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "s3lam/base/memory.h"

namespace s3lam {

/// Room for data in bulk: memory where that leaves enough of it to everything else, else a file,
/// which the system keeps in memory as far as it can. The file has no name and ends with the
/// program, however that ends; it lies in TMPDIR, or /tmp.
class ScratchMemory {
 public:
  ScratchMemory() = default;
  /// Throws std::runtime_error naming `what`, and what there is, if neither has room.
  ScratchMemory(uint64_t bytes, std::string_view what, uint64_t available = AvailableMemory());
  ~ScratchMemory();
  ScratchMemory(ScratchMemory&& other) noexcept;
  ScratchMemory& operator=(ScratchMemory&& other) noexcept;

  /// All zero to begin with.
  [[nodiscard]] std::byte* data() const { return data_; }
  [[nodiscard]] bool IsFile() const { return is_file_; }

 private:
  std::byte* data_ = nullptr;
  uint64_t bytes_ = 0;
  bool is_file_ = false;
};

}  // namespace s3lam
