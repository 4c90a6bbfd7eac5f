#pragma once

#include <string>
#include <thread>

namespace s3lam {

/// While it lives: SIGINT and SIGTERM remove the outputs that are not committed and end the program
/// with 128 + the signal's number (130, 143), a second one at once; SIGUSR1 prints what is being
/// done to stderr. A signal that the program was started with as ignored (nohup) stays ignored.
///
/// A thread waits for the signals, because hardly anything may be called from a handler.
class SignalWatch {
 public:
  explicit SignalWatch(std::string program);
  /// Does not return if the program is being ended by a signal.
  ~SignalWatch();
  SignalWatch(const SignalWatch&) = delete;
  SignalWatch& operator=(const SignalWatch&) = delete;

  /// Said when a signal ends the program from now on, e.g. how to go on; empty for nothing.
  static void SetAdvice(const std::string& advice);

  /// True once a signal is ending the program: errors that follow from that are not worth a word.
  static bool IsEnding();

 private:
  void Watch() const;

  std::string program_;
  std::thread thread_;
};

}  // namespace s3lam
