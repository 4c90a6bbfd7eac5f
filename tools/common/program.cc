#include "common/program.h"

#include <fmt/format.h>
#include <sys/resource.h>

#include <atomic>
#include <boost/any.hpp>
#include <clocale>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <iostream>
#include <new>
#include <opencv2/core.hpp>
#include <sstream>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/base/progress.h"
#include "s3lam/base/signal_watch.h"
#include "s3lam/base/version.h"
#include "s3lam/io/file.h"
#include "s3lam/io/image_file.h"

namespace s3lam::tools {
namespace po = boost::program_options;
namespace {

constexpr int kFailed = 1;
constexpr int kUsage = 2;
constexpr int kBadInput = 3;

po::options_description CommonDescription() {
  po::options_description description("Common options");
  auto add = description.add_options();
  add("config", po::value<std::string>()->value_name("FILE"), "JSON configuration");
  add("set", po::value<std::vector<std::string>>()->composing()->value_name("KEY.PATH=VALUE"),
      "set one configuration value; may be repeated");
  add("threads", po::value<int>()->default_value(0), "threads to use, 0 for all");
  add("seed", po::value<int64_t>()->default_value(0), "seed of all randomness, 0 or more");
  add("progress", po::value<std::string>()->default_value("bar"),
      "progress on stderr: bar, json or none");
  add("json", po::bool_switch(), "print the final report as JSON");
  add("overwrite", po::bool_switch(), "replace an existing output");
  add("quiet", po::bool_switch(), "only warnings and errors on stderr");
  add("print-config", "print the default configuration as JSON and exit");
  add("help,h", "print this text and exit");
  add("version", "print the version and exit");
  return description;
}

CommonArguments ParseCommon(const po::variables_map& arguments) {
  CommonArguments common;
  if (arguments.count("config") > 0) common.config_file = arguments["config"].as<std::string>();
  if (arguments.count("set") > 0) {
    common.assignments = arguments["set"].as<std::vector<std::string>>();
  }
  common.threads = arguments["threads"].as<int>();
  if (common.threads < 0) throw UsageError("--threads must not be negative");
  const auto seed = arguments["seed"].as<int64_t>();
  if (seed < 0) throw UsageError("--seed must not be negative");
  common.seed = static_cast<uint64_t>(seed);
  common.overwrite = arguments["overwrite"].as<bool>();
  common.quiet = arguments["quiet"].as<bool>();
  common.json = arguments["json"].as<bool>();
  const std::string progress = arguments["progress"].as<std::string>();
  if (progress == "bar") {
    SetProgressStyle(common.quiet ? ProgressStyle::kNone : ProgressStyle::kBar);
  } else if (progress == "json") {
    SetProgressStyle(ProgressStyle::kJson);
  } else if (progress == "none") {
    SetProgressStyle(ProgressStyle::kNone);
  } else {
    throw UsageError(fmt::format("--progress {}: expected bar, json or none", progress));
  }
  return common;
}

void PrintHelp(const Program& program, const po::options_description& all) {
  std::ostringstream text;
  text << program.name << " " << Version() << "\n\n" << program.description << "\n\n" << all;
  if (!program.option_help.empty()) {
    text << "\nConfiguration (--config, --set), with defaults:\n" << program.option_help;
  }
  text << "\nExit codes: 0 done, 1 failed, 2 wrong usage, 3 bad input, 130 and 143 ended by SIGINT "
          "or "
          "SIGTERM.\nSIGUSR1 prints what is being done.\n";
  std::cout << text.str();
}

/// One line: names of files may have line breaks in them, or sequences that a terminal obeys.
std::string OneLine(std::string text) {
  while (!text.empty() && text.back() == '\n') text.pop_back();
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  return text;
}

/// Replacing the folder or file that the argument `output` names must not take inputs away that lie
/// in it, or are it. Throws UsageError naming the first.
void CheckOutputHoldsNoInput(const po::variables_map& arguments, const std::string& output) {
  namespace fs = std::filesystem;
  if (arguments.count(output) == 0) return;
  std::error_code error;
  const fs::path replaced = fs::canonical(arguments[output].as<std::string>(), error);
  if (error) return;  // There is nothing to replace.
  for (const auto& [name, value] : arguments) {
    const auto* text = boost::any_cast<std::string>(&value.value());
    if (name == output || text == nullptr || text->empty()) continue;
    const fs::path input = fs::canonical(*text, error);
    if (error) continue;  // A name of something else, or missing, which others say.
    const fs::path inside = input.lexically_relative(replaced);
    if (inside.empty() || *inside.begin() == "..") continue;
    throw UsageError(
        fmt::format("--overwrite would remove --{} {} with {}", name, *text, replaced.string()));
  }
}

/// Throws UsageError for a word that belongs to no option.
po::variables_map ParseArguments(int argc, char** argv, const po::options_description& all) {
  const auto style = po::command_line_style::unix_style & ~po::command_line_style::allow_guessing;
  const auto parsed = po::command_line_parser(argc, argv).options(all).style(style).run();
  for (const po::option& option : parsed.options) {
    if (!option.string_key.empty() || option.value.empty()) continue;
    throw UsageError(fmt::format("'{}' belongs to no option (see --help)", option.value.front()));
  }
  po::variables_map arguments;
  po::store(parsed, arguments);
  po::notify(arguments);
  return arguments;
}

int RunParsed(int argc, char** argv, const Program& program) {
  po::options_description all;
  all.add(program.arguments).add(CommonDescription());
  const po::variables_map arguments = ParseArguments(argc, argv, all);
  if (arguments.count("help") > 0) {
    PrintHelp(program, all);
    return 0;
  }
  if (arguments.count("version") > 0) {
    std::cout << program.name << " " << Version() << "\n";
    return 0;
  }
  if (arguments.count("print-config") > 0) {
    std::cout << program.default_config.dump(2) << "\n";
    return 0;
  }
  const CommonArguments common = ParseCommon(arguments);
  if (common.overwrite) {
    for (const std::string& output : program.outputs) {
      CheckOutputHoldsNoInput(arguments, output);
    }
  }
  InitLogging(common.quiet);
  {
    PrepareImageDecoders();
    const SignalWatch watch(program.name);
    program.run(arguments, common);
  }
  std::cout.flush();
  if (!std::cout) throw std::runtime_error("cannot write the report to standard output");
  return 0;
}

/// The exit code, after one line on stderr about what went wrong. `out_of_memory` is set if that
/// was it.
int RunAndExplain(int argc, char** argv, const Program& program, bool& out_of_memory) {
  const auto fail = [&](int code, const char* what) {
    fmt::print(stderr, "{}: {}\n", program.name, OneLine(what));
    return code;
  };
  constexpr const char* kOutOfMemory =
      "out of memory: give it more (ulimit -v, container), or less to do";
  try {
    return RunParsed(argc, argv, program);
  } catch (const UsageError& error) {
    return fail(kUsage, error.what());
  } catch (const po::error& error) {
    return fail(kUsage, fmt::format("{} (see --help)", error.what()).c_str());
  } catch (const InputError& error) {
    return fail(kBadInput, error.what());
  } catch (const std::bad_alloc&) {
    out_of_memory = true;
    return fail(kFailed, kOutOfMemory);
  } catch (const cv::Exception& error) {
    out_of_memory = error.code == cv::Error::StsNoMem;
    return fail(kFailed, out_of_memory ? kOutOfMemory : error.what());
  } catch (const std::exception& error) {
    return fail(kFailed, error.what());
  }
}

/// Memory for what follows the first failure to get any: exceptions in flight, and destructors that
/// must not fail but ask for memory, as nlohmann::json's do.
std::atomic<void*> memory_reserve{nullptr};
constexpr size_t kReserveBytes = size_t{4} << 20U;

/// A new_handler.
void GiveUpMemoryReserve() {
  std::free(memory_reserve.exchange(nullptr));
  throw std::bad_alloc();
}

bool IsAddressSpaceLimited() {
  rlimit limit{};
  return getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY;
}

}  // namespace

int RunProgram(int argc, char** argv, const Program& program) {
  std::setlocale(LC_ALL, "C");
  memory_reserve = std::malloc(kReserveBytes);
  std::set_new_handler(GiveUpMemoryReserve);
  bool out_of_memory = false;
  const int code = RunAndExplain(argc, argv, program, out_of_memory);
  // Not by way of exit handlers: OpenBLAS's waits for threads that try for memory for ever.
  if (out_of_memory || IsAddressSpaceLimited()) {
    std::fflush(nullptr);
    std::_Exit(code);
  }
  return code;
}

nlohmann::json ReadConfigFile(const CommonArguments& common) {
  if (common.config_file.empty()) return nlohmann::json::object();
  return ReadJson(common.config_file);
}

std::string Required(const po::variables_map& arguments, const std::string& name) {
  if (arguments.count(name) == 0 || arguments[name].as<std::string>().empty()) {
    throw UsageError(fmt::format("--{} is required (see --help)", name));
  }
  return arguments[name].as<std::string>();
}

void PrintReport(const CommonArguments& common, const std::string& table,
                 const nlohmann::json& report) {
  std::cout << (common.json ? JsonText(report) : table);
}

}  // namespace s3lam::tools
