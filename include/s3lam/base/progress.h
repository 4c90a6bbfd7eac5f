#pragma once

#include <cstdint>
#include <string>

#include "s3lam/base/timer.h"

namespace s3lam {

enum class ProgressStyle { kBar, kJson, kNone };

/// Chooses what Progress prints (to stderr) from now on, for the whole program.
void SetProgressStyle(ProgressStyle style);

/// One line about what is being done at this moment, for who asks in between: the step, how long it
/// has taken, and its progress if it counts. May be called from any thread.
std::string DescribeProgress();

/// Progress of one step: count, rate and time left, on stderr, at most a few times a second.
///   bar:  "tracking  [#####.....]  512/1000  95.1/s  5 s left  (keyframes 61)"
///   json: {"step": "tracking", "done": 512, "total": 1000, "rate": 95.1, "eta_s": 5.1, "note":
///   ...}
class Progress {
 public:
  Progress(std::string step, int64_t total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `done` of total are finished; `note` is appended for the reader.
  void Update(int64_t done, const std::string& note = {});

 private:
  void Print(const std::string& note);

  std::string step_;
  int64_t total_;
  int64_t done_ = 0;
  Timer timer_;
  double last_print_s_ = -1.0;
  bool printed_ = false;
};

}  // namespace s3lam
