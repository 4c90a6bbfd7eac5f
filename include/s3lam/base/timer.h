#pragma once

#include <chrono>
#include <map>
#include <string>

namespace s3lam {

/// Wall-clock stopwatch, started on construction.
class Timer {
 public:
  [[nodiscard]] double Seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// Wall seconds by step name, summed over repeated calls. Part of every stage's report.
using StepTimes = std::map<std::string, double>;

namespace internal {
/// The steps under way, outermost first; for CurrentStep().
void EnterStep(const char* name);
void LeaveStep();
}  // namespace internal

/// Adds the time of its own life to one entry of a StepTimes. The name is a literal.
class ScopedStep {
 public:
  ScopedStep(StepTimes& times, const char* name) : seconds_(times[name]) {
    internal::EnterStep(name);
  }
  ~ScopedStep() {
    seconds_ += timer_.Seconds();
    internal::LeaveStep();
  }
  ScopedStep(const ScopedStep&) = delete;
  ScopedStep& operator=(const ScopedStep&) = delete;

 private:
  double& seconds_;
  Timer timer_;
};

/// The innermost step under way and the seconds since it began; an empty name outside of any. May
/// be called from any thread.
struct StepUnderWay {
  std::string name;
  double seconds = 0.0;
};
StepUnderWay CurrentStep();

/// Largest resident set of this process so far, in MiB.
double PeakMemoryMiB();

}  // namespace s3lam
