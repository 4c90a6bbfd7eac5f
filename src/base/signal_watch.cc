#include "s3lam/base/signal_watch.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <mutex>

#include "s3lam/base/error.h"
#include "s3lam/base/output_directory.h"
#include "s3lam/base/progress.h"

namespace s3lam {
namespace {

constexpr std::array<int, 3> kSignals = {SIGINT, SIGTERM, SIGUSR1};
constexpr char kQuit = 0;  // Not the number of a signal.

// The handler writes the signal's number to a pipe; the thread reads it.
std::array<int, 2> g_pipe = {-1, -1};
std::atomic<bool> g_is_ending{false};
std::mutex g_advice_mutex;
std::string g_advice;  // NOLINT: empty at start.
static_assert(std::atomic<bool>::is_always_lock_free, "for use in a signal handler");

void Tell(char what) {
  while (write(g_pipe[1], &what, 1) < 0 && errno == EINTR) {
  }
}

void Handle(int signal) {
  const int saved_errno = errno;
  if (signal != SIGUSR1) g_is_ending = true;
  Tell(static_cast<char>(signal));
  errno = saved_errno;
}

void Install(int signal) {
  struct sigaction old {};
  if (sigaction(signal, nullptr, &old) != 0 || old.sa_handler == SIG_IGN) return;
  struct sigaction action {};
  action.sa_handler = Handle;
  action.sa_flags = SA_RESTART;
  if (signal != SIGUSR1) action.sa_flags |= SA_RESETHAND;  // A second one is not waited for.
  sigemptyset(&action.sa_mask);
  sigaction(signal, &action, nullptr);
}

}  // namespace

SignalWatch::SignalWatch(std::string program) : program_(std::move(program)) {
  S3LAM_CHECK(g_pipe[0] < 0);  // There is one at a time.
  if (pipe2(g_pipe.data(), O_CLOEXEC) != 0) throw std::runtime_error("cannot make a pipe");
  thread_ = std::thread([this] { Watch(); });
  for (const int signal : kSignals) Install(signal);
}

SignalWatch::~SignalWatch() {
  for (const int number : kSignals) {
    struct sigaction current {};
    sigaction(number, nullptr, &current);
    if (current.sa_handler == Handle) signal(number, number == SIGUSR1 ? SIG_IGN : SIG_DFL);
  }
  if (!IsEnding()) Tell(kQuit);
  thread_.join();
  for (int& fd : g_pipe) {
    close(fd);
    fd = -1;
  }
}

void SignalWatch::SetAdvice(const std::string& advice) {
  const std::lock_guard lock(g_advice_mutex);
  g_advice = advice;
}

bool SignalWatch::IsEnding() { return g_is_ending; }

void SignalWatch::Watch() const {
  while (true) {
    char what = kQuit;
    const ssize_t size = read(g_pipe[0], &what, 1);
    if (size < 0 && errno == EINTR) continue;
    if (size <= 0 || what == kQuit) return;
    if (what == SIGUSR1) {
      fmt::print(stderr, "{}: {}\n", program_, DescribeProgress());
      continue;
    }
    AbandonOutputs();
    const std::lock_guard lock(g_advice_mutex);
    fmt::print(stderr, "{}: ended by {}; no partial output is left{}{}\n", program_,
               what == SIGINT ? "SIGINT" : "SIGTERM", g_advice.empty() ? "" : "; ", g_advice);
    _exit(128 + what);
  }
}

}  // namespace s3lam
