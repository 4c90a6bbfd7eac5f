// A library for LD_PRELOAD that lets system calls on files fail, as a disk does that is full or
// broken.
//
//   S3LAM_FAULT=CALL:N:WHAT   the N-th (from 1) CALL fails with the error WHAT (ENOSPC, EIO), or,
//   for
//                             `write` and WHAT = short, writes a byte only; N = 0: every one
//   S3LAM_FAULT_COUNTS=FILE   how many calls of each kind there were, written at the end
//
// CALL is write (write, pwrite64, writev and copies within the kernel, to regular files), fsync,
// rename, open (for writing) or mkdir. Counted over all threads.

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace {

enum Call { kWrite, kFsync, kRename, kOpen, kMkdir, kNumCalls };
constexpr std::array<const char*, kNumCalls> kNames = {"write", "fsync", "rename", "open", "mkdir"};

std::array<std::atomic<long>, kNumCalls> g_counts;

struct Fault {
  int call = -1;
  long index = 0;
  bool is_short = false;
  int error = EIO;
};

const Fault& TheFault() {
  static const Fault fault = [] {
    Fault parsed;
    const char* text = std::getenv("S3LAM_FAULT");
    if (text == nullptr) return parsed;
    for (int call = 0; call < kNumCalls; ++call) {
      const size_t length = std::strlen(kNames[call]);
      if (std::strncmp(text, kNames[call], length) != 0 || text[length] != ':') continue;
      char* end = nullptr;
      parsed.call = call;
      parsed.index = std::strtol(text + length + 1, &end, 10);
      parsed.is_short = std::strcmp(end, ":short") == 0;
      if (std::strcmp(end, ":ENOSPC") == 0) parsed.error = ENOSPC;
    }
    return parsed;
  }();
  return fault;
}

/// Counts a call and says whether it is one to go wrong.
bool GoesWrong(Call call) {
  const long index = ++g_counts[call];
  const Fault& fault = TheFault();
  return fault.call == call && (fault.index == 0 || fault.index == index);
}

bool Fails(Call call) {
  if (!GoesWrong(call)) return false;
  errno = TheFault().error;
  return true;
}

bool IsRegularFile(int fd) {
  struct stat status {};
  return fstat(fd, &status) == 0 && S_ISREG(status.st_mode);
}

template <typename Function>
Function Next(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

struct CountsAtEnd {
  ~CountsAtEnd() {
    std::array<long, kNumCalls> counts;  // Before this adds to them.
    for (int call = 0; call < kNumCalls; ++call) counts[call] = g_counts[call];
    const char* path = std::getenv("S3LAM_FAULT_COUNTS");
    FILE* file = path == nullptr ? nullptr : std::fopen(path, "w");
    if (file == nullptr) return;
    for (int call = 0; call < kNumCalls; ++call) {
      std::fprintf(file, "%s %ld\n", kNames[call], counts[call]);
    }
    std::fclose(file);
  }
} g_counts_at_end;

using Write = ssize_t (*)(int, const void*, size_t);

}  // namespace

extern "C" {

ssize_t write(int fd, const void* data, size_t size) {
  static const auto next = Next<Write>("write");
  if (!IsRegularFile(fd) || !GoesWrong(kWrite)) return next(fd, data, size);
  if (TheFault().is_short) return next(fd, data, size > 0 ? 1 : 0);
  errno = TheFault().error;
  return -1;
}

ssize_t pwrite64(int fd, const void* data, size_t size, off64_t offset) {
  static const auto next = Next<ssize_t (*)(int, const void*, size_t, off64_t)>("pwrite64");
  if (!IsRegularFile(fd) || !GoesWrong(kWrite)) return next(fd, data, size, offset);
  if (TheFault().is_short) return next(fd, data, size > 0 ? 1 : 0, offset);
  errno = TheFault().error;
  return -1;
}

ssize_t writev(int fd, const struct iovec* parts, int count) {
  static const auto next = Next<ssize_t (*)(int, const struct iovec*, int)>("writev");
  static const auto next_write = Next<Write>("write");
  if (!IsRegularFile(fd) || !GoesWrong(kWrite)) return next(fd, parts, count);
  for (int i = 0; TheFault().is_short && i < count; ++i) {
    if (parts[i].iov_len > 0) return next_write(fd, parts[i].iov_base, 1);
  }
  errno = TheFault().error;
  return -1;
}

ssize_t sendfile(int out, int in, off_t* offset, size_t size) {
  static const auto next = Next<ssize_t (*)(int, int, off_t*, size_t)>("sendfile");
  if (!IsRegularFile(out) || !GoesWrong(kWrite)) return next(out, in, offset, size);
  if (TheFault().is_short) return next(out, in, offset, size > 0 ? 1 : 0);
  errno = TheFault().error;
  return -1;
}

ssize_t copy_file_range(int in, off64_t* in_offset, int out, off64_t* out_offset, size_t size,
                        unsigned int flags) {
  static const auto next =
      Next<ssize_t (*)(int, off64_t*, int, off64_t*, size_t, unsigned int)>("copy_file_range");
  if (!GoesWrong(kWrite)) return next(in, in_offset, out, out_offset, size, flags);
  if (TheFault().is_short) return next(in, in_offset, out, out_offset, size > 0 ? 1 : 0, flags);
  errno = TheFault().error;
  return -1;
}

int fsync(int fd) {
  static const auto next = Next<int (*)(int)>("fsync");
  return Fails(kFsync) ? -1 : next(fd);
}

int rename(const char* from, const char* to) {
  static const auto next = Next<int (*)(const char*, const char*)>("rename");
  return Fails(kRename) ? -1 : next(from, to);
}

int renameat2(int from_fd, const char* from, int to_fd, const char* to, unsigned int flags) {
  static const auto next =
      Next<int (*)(int, const char*, int, const char*, unsigned int)>("renameat2");
  return Fails(kRename) ? -1 : next(from_fd, from, to_fd, to, flags);
}

FILE* fopen(const char* path, const char* mode) {
  static const auto next = Next<FILE* (*)(const char*, const char*)>("fopen");
  if (std::strpbrk(mode, "wa+") != nullptr && Fails(kOpen)) return nullptr;
  return next(path, mode);
}

FILE* fopen64(const char* path, const char* mode) {
  static const auto next = Next<FILE* (*)(const char*, const char*)>("fopen64");
  if (std::strpbrk(mode, "wa+") != nullptr && Fails(kOpen)) return nullptr;
  return next(path, mode);
}

int open(const char* path, int flags, ...) {
  static const auto next = Next<int (*)(const char*, int, ...)>("open");
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(arguments, mode_t) : 0;
  va_end(arguments);
  if ((flags & O_ACCMODE) != O_RDONLY && Fails(kOpen)) return -1;
  return next(path, flags, mode);
}

int mkdir(const char* path, mode_t mode) {
  static const auto next = Next<int (*)(const char*, mode_t)>("mkdir");
  return Fails(kMkdir) ? -1 : next(path, mode);
}

}  // extern "C"
