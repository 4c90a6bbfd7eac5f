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

/// Adds the time of its own life to one entry of a StepTimes.
class ScopedStep {
 public:
  ScopedStep(StepTimes& times, const char* name) : seconds_(times[name]) {}
  ~ScopedStep() { seconds_ += timer_.Seconds(); }
  ScopedStep(const ScopedStep&) = delete;
  ScopedStep& operator=(const ScopedStep&) = delete;

 private:
  double& seconds_;
  Timer timer_;
};

/// Largest resident set of this process so far, in MiB.
double PeakMemoryMiB();

}  // namespace s3lam
