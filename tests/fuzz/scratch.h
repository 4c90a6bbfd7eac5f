#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>

namespace s3lam::fuzz {

/// Makes `size` bytes at `fd`'s beginning the whole file.
inline void Fill(int fd, std::string_view bytes) {
  if (ftruncate(fd, 0) != 0 ||
      pwrite(fd, bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    throw std::runtime_error("cannot write the scratch file");
  }
}

/// A file in memory that has a path, for readers that want one.
class MemoryFile {
 public:
  MemoryFile() : fd_(memfd_create("fuzz", MFD_CLOEXEC)) {
    if (fd_ < 0) throw std::runtime_error("cannot create a file in memory");
  }
  ~MemoryFile() { close(fd_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  const MemoryFile& Write(std::string_view bytes) const {
    Fill(fd_, bytes);
    return *this;
  }
  [[nodiscard]] std::filesystem::path path() const {
    return "/proc/self/fd/" + std::to_string(fd_);
  }

 private:
  int fd_;
};

/// Path of a file in memory that holds `bytes`, until the next call.
inline std::filesystem::path PathOf(std::string_view bytes) {
  static const MemoryFile file;
  return file.Write(bytes).path();
}

}  // namespace s3lam::fuzz
