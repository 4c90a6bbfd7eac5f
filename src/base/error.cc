#include "s3lam/base/error.h"

namespace s3lam::internal {

void FailCheck(const char* file, int line, const char* condition, const std::string& message) {
  throw std::logic_error(fmt::format("{}:{}: check failed: {}{}{}", file, line, condition,
                                     message.empty() ? "" : ": ", message));
}

}  // namespace s3lam::internal
