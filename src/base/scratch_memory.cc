#include "s3lam/base/scratch_memory.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "s3lam/base/log.h"

namespace s3lam {
namespace {

/// A file without a name and of this size, whose room on the disk is taken. Negative, with errno
/// set, if that fails.
int OpenScratchFile(const std::string& directory, uint64_t bytes) {
  std::string path = directory + "/s3lam-XXXXXX";
  const int file = mkostemp(path.data(), O_CLOEXEC);
  if (file < 0) return file;
  unlink(path.c_str());
  const int error = posix_fallocate(file, 0, static_cast<off_t>(bytes));
  if (error == 0) return file;
  close(file);
  errno = error;
  return -1;
}

void* MapFile(const std::string& directory, uint64_t bytes) {
  const int file = OpenScratchFile(directory, bytes);
  if (file < 0) return MAP_FAILED;
  void* data = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  const int error = errno;
  close(file);  // The mapping keeps it.
  errno = error;
  return data;
}

}  // namespace

ScratchMemory::ScratchMemory(uint64_t bytes, std::string_view what, uint64_t available)
    : bytes_(bytes) {
  if (bytes == 0) return;
  constexpr uint64_t kPartLeft = 5;  // Of the memory, to everything else.
  void* data = MAP_FAILED;
  if (bytes <= available - available / kPartLeft) {
    data = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  }
  if (data == MAP_FAILED) {
    std::error_code error;
    std::string directory = std::filesystem::temp_directory_path(error).string();
    if (error) directory = "/tmp";
    data = MapFile(directory, bytes);
    if (data == MAP_FAILED) {
      throw std::runtime_error(
          fmt::format("{}: {} MiB are needed, of {} MiB of memory that are free, or in {} (set "
                      "TMPDIR for another place): {}",
                      what, bytes >> 20, available >> 20, directory, std::strerror(errno)));
    }
    is_file_ = true;
    spdlog::info("{}: {} MiB of {} MiB of free memory, so they are kept in {}", what, bytes >> 20,
                 available >> 20, directory);
  }
  data_ = static_cast<std::byte*>(data);
}

ScratchMemory::~ScratchMemory() {
  if (data_ != nullptr) munmap(data_, bytes_);
}

ScratchMemory::ScratchMemory(ScratchMemory&& other) noexcept
    : data_(std::exchange(other.data_, nullptr)),
      bytes_(std::exchange(other.bytes_, 0)),
      is_file_(other.is_file_) {}

ScratchMemory& ScratchMemory::operator=(ScratchMemory&& other) noexcept {
  std::swap(data_, other.data_);
  std::swap(bytes_, other.bytes_);
  std::swap(is_file_, other.is_file_);
  return *this;
}

}  // namespace s3lam
