#include "common/config_files.h"

#include <array>
#include <system_error>

namespace s3lam::tools {
namespace fs = std::filesystem;

fs::path ConfigDirectory() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  const fs::path root = program.parent_path().parent_path();
  // <prefix>/bin, or <source>/build/bin.
  const std::array<fs::path, 2> candidates = {root / "share" / "s3lam" / "configs",
                                              root.parent_path() / "configs"};
  for (const fs::path& directory : candidates) {
    if (!error && fs::is_directory(directory / "classes", error)) return directory;
  }
  return {};
}

fs::path FindConfigFile(const std::string& argument, const std::string& kind) {
  std::error_code error;
  const bool is_name = argument.find('/') == std::string::npos;
  if (!is_name || fs::exists(argument, error)) return argument;
  const fs::path directory = ConfigDirectory();
  if (directory.empty()) return argument;
  fs::path file = directory / kind / argument;
  if (file.extension() != ".json") file += ".json";
  return fs::is_regular_file(file, error) ? file : fs::path(argument);
}

}  // namespace s3lam::tools
