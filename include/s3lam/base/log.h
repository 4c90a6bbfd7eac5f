#pragma once

#include <spdlog/spdlog.h>

namespace s3lam {

/// Sends the log (spdlog's default logger, used as spdlog::info(...) and so on) to stderr without
/// colours; `quiet` keeps warnings and errors only.
void InitLogging(bool quiet);

}  // namespace s3lam
