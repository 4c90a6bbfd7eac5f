#include "s3lam/base/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>

namespace s3lam {
namespace {

ProgressStyle g_style = ProgressStyle::kNone;

/// What DescribeProgress() tells of the Progress that was updated last.
struct Count {
  std::string step;
  int64_t done = 0;
  int64_t total = 0;
  Timer timer;
};
std::mutex g_count_mutex;
std::optional<Count> g_count;  // NOLINT: empty at start and at the end.

constexpr double kSecondsBetweenLines = 0.2;
constexpr double kSecondsBetweenLogLines = 5.0;  // Where stderr is a file, nothing can be redrawn.

}  // namespace

void SetProgressStyle(ProgressStyle style) { g_style = style; }

std::string DescribeProgress() {
  const StepUnderWay step = CurrentStep();
  std::string text = step.name.empty() ? "reading or writing"
                                       : fmt::format("{} for {:.1f} s", step.name, step.seconds);
  const std::lock_guard lock(g_count_mutex);
  if (g_count) {
    text += fmt::format("; {}: {} of {} in {:.1f} s", g_count->step, g_count->done, g_count->total,
                        g_count->timer.Seconds());
  }
  return text;
}

Progress::Progress(std::string step, int64_t total) : step_(std::move(step)), total_(total) {
  const std::lock_guard lock(g_count_mutex);
  g_count = Count{step_, 0, total_, timer_};
}

Progress::~Progress() {
  {
    const std::lock_guard lock(g_count_mutex);
    g_count.reset();
  }
  if (printed_ && g_style == ProgressStyle::kBar && isatty(STDERR_FILENO)) fputc('\n', stderr);
}

void Progress::Update(int64_t done, const std::string& note) {
  done_ = done;
  {
    const std::lock_guard lock(g_count_mutex);
    if (g_count) g_count->done = done;
  }
  if (g_style == ProgressStyle::kNone) return;
  const bool redraws = g_style == ProgressStyle::kBar && isatty(STDERR_FILENO);
  const double interval = redraws ? kSecondsBetweenLines : kSecondsBetweenLogLines;
  const double now = timer_.Seconds();
  const bool finished = done >= total_;
  if (!finished && (last_print_s_ < 0.0 ? now : now - last_print_s_) < interval) return;
  last_print_s_ = now;
  printed_ = true;
  Print(note);
}

void Progress::Print(const std::string& note) {
  const double seconds = std::max(timer_.Seconds(), 1e-9);
  const double rate = static_cast<double>(done_) / seconds;
  const double left = rate > 0.0 ? static_cast<double>(total_ - done_) / rate : 0.0;
  if (g_style == ProgressStyle::kJson) {
    nlohmann::json line{{"step", step_}, {"done", done_}, {"total", total_},
                        {"rate", rate},  {"eta_s", left}, {"note", note}};
    using Json = nlohmann::json;
    fmt::print(stderr, "{}\n", line.dump(-1, ' ', false, Json::error_handler_t::replace));
    return;
  }
  constexpr int kWidth = 24;
  const int filled = total_ > 0 ? static_cast<int>(kWidth * done_ / total_) : kWidth;
  const bool redraws = isatty(STDERR_FILENO);
  fmt::print(stderr, "{}{:<20} [{:#<{}}{:.<{}}] {}/{}  {:.1f}/s  {:.0f} s left  {}{}",
             redraws ? "\r" : "", step_, "", std::min(filled, kWidth), "",
             kWidth - std::min(filled, kWidth), done_, total_, rate, left, note,
             redraws ? "\x1b[K" : "\n");
}

}  // namespace s3lam
