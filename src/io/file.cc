#include "s3lam/io/file.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <system_error>

#include "s3lam/base/error.h"

namespace s3lam {

std::string ReadFile(const std::filesystem::path& path) {
  std::error_code ignored;  // What cannot be looked at cannot be opened either.
  if (std::filesystem::is_directory(path, ignored)) {
    ThrowInputError("{}: is a directory, expected a file", path.string());
  }
  std::ifstream stream(path, std::ios::binary);
  if (!stream) ThrowInputError("{}: cannot open: {}", path.string(), std::strerror(errno));
  std::ostringstream content;
  content << stream.rdbuf();
  if (stream.bad() || content.bad()) ThrowInputError("{}: cannot read", path.string());
  return std::move(content).str();
}

void WriteFile(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body) {
  std::ofstream stream(path, std::ios::binary | std::ios::trunc);
  stream.imbue(std::locale::classic());
  if (stream) body(stream);
  stream.close();
  if (!stream) {
    throw std::runtime_error(
        fmt::format("{}: cannot write: {}", path.string(), std::strerror(errno)));
  }
}

nlohmann::json ReadJson(const std::filesystem::path& path) {
  const std::string text = ReadFile(path);
  try {
    return nlohmann::json::parse(text);
  } catch (const nlohmann::json::parse_error& error) {
    ThrowInputError("{}: not valid JSON near byte {}", path.string(), error.byte);
  }
}

void WriteJson(const std::filesystem::path& path, const nlohmann::json& json) {
  // File names need not be UTF-8; JSON has to be.
  using Json = nlohmann::json;
  const std::string text = json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
  WriteFile(path, [&](std::ostream& stream) { stream << text; });
}

}  // namespace s3lam
