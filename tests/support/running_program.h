#pragma once

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

namespace s3lam::testing {

/// A program that runs beside the test, with its standard error in a file.
class RunningProgram {
 public:
  RunningProgram(std::vector<std::string> words, const std::filesystem::path& errors) {
    pid_ = fork();
    if (pid_ != 0) return;
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    if (freopen(errors.c_str(), "w", stderr) != nullptr &&
        freopen("/dev/null", "w", stdout) != nullptr) {
      execv(arguments[0], arguments.data());
    }
    _exit(127);
  }
  void Send(int signal) const { kill(pid_, signal); }
  /// True once it has ended; Wait() is still to be called.
  [[nodiscard]] bool HasEnded() const {
    siginfo_t info{};
    return waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT) == 0 &&
           info.si_pid == pid_;
  }
  /// The exit code, or minus the number of the signal that ended it.
  [[nodiscard]] int Wait() const {
    int status = 0;
    waitpid(pid_, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }

 private:
  pid_t pid_ = -1;
};

}  // namespace s3lam::testing
