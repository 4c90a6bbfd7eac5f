#include "s3lam/base/memory.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>

namespace s3lam {
namespace {

constexpr uint64_t kUnlimited = std::numeric_limits<uint64_t>::max();
constexpr uint64_t kNotWorthAsking = 64ULL << 20;

/// The first number in a file of the kernel; `otherwise` if there is none ("max", no such file).
uint64_t NumberIn(const char* path, uint64_t otherwise) {
  std::ifstream stream(path);
  uint64_t value = 0;
  return stream >> value ? value : otherwise;
}

/// The number behind a key at the beginning of a line; `otherwise` if there is none.
uint64_t NumberBehind(std::string_view key, const char* path, uint64_t otherwise) {
  std::ifstream stream(path);
  std::string word;
  for (uint64_t value = 0; stream >> word;) {
    if (word == key && stream >> value) return value;
  }
  return otherwise;
}

uint64_t FreeOfMachine() {
  const uint64_t kibibytes = NumberBehind("MemAvailable:", "/proc/meminfo", kUnlimited);
  return kibibytes == kUnlimited ? kUnlimited : 1024 * kibibytes;
}

/// Of version 2, as seen from inside a container, whose own group is the root of what it sees.
/// Files that the kernel keeps in memory count as used there, but give way.
uint64_t FreeOfControlGroup() {
  const uint64_t limit = NumberIn("/sys/fs/cgroup/memory.max", kUnlimited);
  if (limit == kUnlimited) return kUnlimited;
  const char* const parts = "/sys/fs/cgroup/memory.stat";
  const uint64_t used = NumberIn("/sys/fs/cgroup/memory.current", 0);
  const uint64_t of_files =
      NumberBehind("inactive_file", parts, 0) + NumberBehind("active_file", parts, 0);
  return limit - std::min(limit, used - std::min(used, of_files));
}

uint64_t FreeOfAddressSpace() {
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return kUnlimited;
  const uint64_t pages = NumberIn("/proc/self/statm", 0);
  const uint64_t used = pages * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
  return limit.rlim_cur - std::min<uint64_t>(limit.rlim_cur, used);
}

}  // namespace

uint64_t AvailableMemory() {
  return std::min({FreeOfMachine(), FreeOfControlGroup(), FreeOfAddressSpace()});
}

void RequireMemory(uint64_t bytes, std::string_view what) {
  if (bytes < kNotWorthAsking) return;
  const uint64_t available = AvailableMemory();
  if (bytes <= available) return;
  throw std::runtime_error(fmt::format("{} needs about {} MiB of memory, but only {} MiB are free",
                                       what, bytes >> 20, available >> 20));
}

}  // namespace s3lam
