#include "common/config_files.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <system_error>
#include <vector>

#include "s3lam/base/error.h"
#include "s3lam/base/options_json.h"

namespace s3lam::tools {
namespace fs = std::filesystem;
namespace {

/// Where the files that come with the project may be: of <prefix>/bin, and of <source>/build/bin.
std::array<fs::path, 2> ConfigDirectories() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  const fs::path root = program.parent_path().parent_path();
  return {root / "share" / "s3lam" / "configs", root.parent_path() / "configs"};
}

[[noreturn]] void ThrowNotFound(const std::string& argument, const std::string& kind) {
  const fs::path directory = ConfigDirectory();
  if (directory.empty()) {
    const auto [installed, in_source] = ConfigDirectories();
    ThrowInputError(
        "{}: no such file, nor are the files that come with the project in {} or {}: give a path",
        argument, installed.string(), in_source.string());
  }
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(directory / kind)) {
    names.push_back(entry.path().stem().string());
  }
  std::sort(names.begin(), names.end());
  ThrowInputError("{}: no such file, nor in {}; did you mean '{}'? (there are {})", argument,
                  (directory / kind).string(), NearestWord(argument, names),
                  fmt::join(names, ", "));
}

}  // namespace

fs::path ConfigDirectory() {
  std::error_code error;
  for (const fs::path& directory : ConfigDirectories()) {
    if (fs::is_directory(directory / "classes", error)) return directory;
  }
  return {};
}

fs::path FindConfigFile(const std::string& argument, const std::string& kind) {
  std::error_code error;
  const bool is_name = !argument.empty() && argument.find('/') == std::string::npos;
  if (!is_name || fs::exists(argument, error)) return argument;
  fs::path file = ConfigDirectory() / kind / argument;
  if (file.extension() != ".json") file += ".json";
  if (!fs::is_regular_file(file, error)) ThrowNotFound(argument, kind);
  return file;
}

}  // namespace s3lam::tools
