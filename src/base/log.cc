#include "s3lam/base/log.h"

#include <spdlog/sinks/stdout_sinks.h>

namespace s3lam {

void InitLogging(bool quiet) {
  auto sink = std::make_shared<spdlog::sinks::stderr_sink_mt>();
  auto logger = std::make_shared<spdlog::logger>("s3lam", std::move(sink));
  logger->set_pattern("%H:%M:%S.%e %l %v");
  logger->set_level(quiet ? spdlog::level::warn : spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
}

}  // namespace s3lam
