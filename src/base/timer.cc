#include "s3lam/base/timer.h"

#include <sys/resource.h>

#include <mutex>
#include <utility>
#include <vector>

namespace s3lam {
namespace {

std::mutex g_mutex;
std::vector<std::pair<const char*, Timer>> g_steps;  // NOLINT: empty at start and at the end.

}  // namespace

namespace internal {

void EnterStep(const char* name) {
  const std::lock_guard lock(g_mutex);
  g_steps.emplace_back(name, Timer());
}

void LeaveStep() {
  const std::lock_guard lock(g_mutex);
  g_steps.pop_back();
}

}  // namespace internal

StepUnderWay CurrentStep() {
  const std::lock_guard lock(g_mutex);
  if (g_steps.empty()) return {};
  return {g_steps.back().first, g_steps.back().second.Seconds()};
}

double PeakMemoryMiB() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;  // Linux gives KiB.
}

}  // namespace s3lam
