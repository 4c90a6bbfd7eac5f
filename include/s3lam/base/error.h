#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>
#include <utility>

namespace s3lam {

/// Something the user handed us is missing, malformed or inconsistent. Programs exit with code 3.
/// The message names the file (or option) and the reason, on one line.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The command line or a configuration value is wrong. Programs exit with code 2.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Throws InputError with a formatted message.
template <typename... Args>
[[noreturn]] void ThrowInputError(fmt::format_string<Args...> format, Args&&... args) {
  throw InputError(fmt::format(format, std::forward<Args>(args)...));
}

namespace internal {
[[noreturn]] void FailCheck(const char* file, int line, const char* condition,
                            const std::string& message);
}  // namespace internal

}  // namespace s3lam

/// A precondition or invariant of the code itself: throws std::logic_error naming file and line.
#define S3LAM_CHECK(condition)                                                          \
  do {                                                                                  \
    if (!(condition)) ::s3lam::internal::FailCheck(__FILE__, __LINE__, #condition, {}); \
  } while (false)

/// As S3LAM_CHECK, with a fmt-style message.
#define S3LAM_CHECK_MSG(condition, ...)                                                         \
  do {                                                                                          \
    if (!(condition))                                                                           \
      ::s3lam::internal::FailCheck(__FILE__, __LINE__, #condition, ::fmt::format(__VA_ARGS__)); \
  } while (false)
