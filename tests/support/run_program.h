#pragma once

#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "support/temp_dir.h"

namespace s3lam::testing {

struct ProgramResult {
  int exit_code = -1;  // -1 if a signal ended it.
  std::string output;  // Standard output; of RunProgram with standard error in it.
  std::string errors;  // Standard error, of RunProgramApart.
};

namespace internal {
inline std::string ShellQuoted(std::string_view word) {
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}
inline std::string ShellCommand(const std::vector<std::string>& words) {
  std::string command;
  for (const std::string& word : words) command += ShellQuoted(word) + " ";
  return command;
}
inline ProgramResult RunShell(const std::string& command) {
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) throw std::runtime_error("cannot run " + command);
  ProgramResult result;
  std::array<char, 4096> buffer;
  while (const size_t size = fread(buffer.data(), 1, buffer.size(), pipe)) {
    result.output.append(buffer.data(), size);
  }
  const int status = pclose(pipe);
  if (WIFEXITED(status)) result.exit_code = WEXITSTATUS(status);
  return result;
}
}  // namespace internal

/// Runs a program and waits for it.
inline ProgramResult RunProgram(const std::vector<std::string>& words) {
  return internal::RunShell(internal::ShellCommand(words) + "2>&1");
}

/// As RunProgram, with standard output and standard error apart.
inline ProgramResult RunProgramApart(const std::vector<std::string>& words) {
  const TempDir directory;
  const std::string errors = (directory / "stderr").string();
  ProgramResult result =
      internal::RunShell(internal::ShellCommand(words) + "2>" + internal::ShellQuoted(errors));
  result.errors = FileBytes(errors);
  return result;
}

/// True if the shell finds a program of this name.
inline bool HasProgram(const std::string& name) {
  return RunProgram({"sh", "-c", "command -v " + name}).exit_code == 0;
}

}  // namespace s3lam::testing
