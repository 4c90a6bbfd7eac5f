#pragma once

#include <boost/program_options.hpp>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "s3lam/base/options_json.h"

namespace s3lam::tools {

/// The arguments every program has.
struct CommonArguments {
  std::string config_file;
  std::vector<std::string> assignments;  // --set key.path=value
  int threads = 0;                       // 0: all hardware threads
  uint64_t seed = 0;
  bool overwrite = false;
  bool quiet = false;
  bool json = false;  // Final report on stdout as JSON instead of a table.
};

/// What distinguishes one program from another.
struct Program {
  std::string name;         // "s3-slam"
  std::string description;  // What it reads, writes and does, for --help.
  /// The program's own command-line options.
  boost::program_options::options_description arguments;
  /// Default options as --help text; empty for a program without a configuration.
  std::string option_help;
  /// Default options as JSON, for --print-config.
  nlohmann::json default_config;
  /// Does the work. Throws InputError, UsageError or any std::exception.
  std::function<void(const boost::program_options::variables_map&, const CommonArguments&)> run;
  /// Names of the arguments that say which folders and files --overwrite replaces.
  std::vector<std::string> outputs = {"output"};
};

/// Parses, handles --help, --version and --print-config, runs, and turns exceptions into one line
/// on stderr. Returns the exit code: 0 done, 1 failed, 2 usage, 3 bad input.
int RunProgram(int argc, char** argv, const Program& program);

/// Fills help and default configuration from an options struct.
template <VisitableOptions T>
void SetConfiguration(const T& defaults, Program& program) {
  program.option_help = DescribeOptions(defaults);
  program.default_config = OptionsToJson(defaults);
}

/// The JSON of --config; an empty object without one.
nlohmann::json ReadConfigFile(const CommonArguments& common);

/// Defaults, then --config, then each --set.
template <VisitableOptions T>
T LoadOptions(const CommonArguments& common) {
  T options;
  OptionsFromJson(ReadConfigFile(common), options,
                  common.config_file.empty() ? "config" : common.config_file);
  for (const std::string& assignment : common.assignments) SetOption(assignment, options);
  CheckOptions(options);
  return options;
}

/// A required string argument; throws UsageError naming it.
std::string Required(const boost::program_options::variables_map& arguments,
                     const std::string& name);

/// Prints the final report to stdout: `table` or, with --json, `report`.
void PrintReport(const CommonArguments& common, const std::string& table,
                 const nlohmann::json& report);

}  // namespace s3lam::tools
