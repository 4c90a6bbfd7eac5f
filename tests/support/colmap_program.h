#pragma once

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "support/run_program.h"

namespace s3lam::testing {

/// Runs `colmap <words>` without a display; throws with its output if it fails.
inline std::string RunColmap(const std::vector<std::string>& words) {
  std::vector<std::string> command = {"env", "QT_QPA_PLATFORM=offscreen", "colmap"};
  command.insert(command.end(), words.begin(), words.end());
  const ProgramResult result = RunProgram(command);
  if (result.exit_code != 0) throw std::runtime_error("colmap failed: " + result.output);
  return result.output;
}

/// The number that `colmap model_analyzer` prints after `name` ("Mean reprojection error").
inline double ColmapAnalysis(const std::filesystem::path& model, const std::string& name) {
  const std::string output = RunColmap({"model_analyzer", "--path", model.string()});
  const size_t place = output.find(name + ":");
  if (place == std::string::npos) throw std::runtime_error("no " + name + " in: " + output);
  return std::strtod(output.c_str() + place + name.size() + 1, nullptr);
}

}  // namespace s3lam::testing
