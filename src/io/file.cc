#include "s3lam/io/file.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

// No file of this project nests deeper than a few levels. Copying and printing a document recurse,
// so an endless "[[[[" could exhaust the stack.
constexpr int kMaxJsonDepth = 64;

/// Where the text nests too deep; its size if nowhere.
size_t FindTooDeep(std::string_view text) {
  int depth = 0;
  bool in_string = false;
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      if (c == '"') in_string = false;
    } else if (c == '"') {
      in_string = true;
    } else if (c == '[' || c == '{') {
      if (++depth > kMaxJsonDepth) return i;
    } else if (c == ']' || c == '}') {
      --depth;
    }
  }
  return text.size();
}

}  // namespace

std::string ReadFile(const std::filesystem::path& path) {
  std::error_code ignored;  // What cannot be looked at cannot be opened either.
  if (std::filesystem::is_directory(path, ignored)) {
    ThrowInputError("{}: is a directory, expected a file", path.string());
  }
  std::ifstream stream(path, std::ios::binary);
  if (!stream) ThrowInputError("{}: cannot open: {}", path.string(), std::strerror(errno));
  return ReadStream(stream, path.string());
}

std::string ReadStream(std::istream& stream, const std::string& source) {
  // Not into another stream: that takes std::bad_alloc for the end of the file.
  std::string content;
  std::array<char, 1 << 16> piece{};
  do {
    stream.read(piece.data(), piece.size());
    content.append(piece.data(), static_cast<size_t>(stream.gcount()));
  } while (stream);
  if (stream.bad()) ThrowInputError("{}: cannot read", source);
  return content;
}

void WriteFile(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body) {
  errno = 0;
  std::ofstream stream(path, std::ios::binary | std::ios::trunc);
  stream.imbue(std::locale::classic());
  if (stream) body(stream);
  stream.close();
  if (!stream) {
    throw std::runtime_error(fmt::format("{}: cannot write: {}", path.string(),
                                         errno == 0 ? "not all was taken" : std::strerror(errno)));
  }
}

bool IsNameWithin(std::string_view name) {
  constexpr std::string_view kForbidden("\n\r\0", 3);
  if (name.empty() || name.front() == '/') return false;
  if (name.find_first_of(kForbidden) != std::string_view::npos) return false;
  const std::filesystem::path path(name);
  return std::find(path.begin(), path.end(), "..") == path.end();
}

nlohmann::json ReadJson(const std::filesystem::path& path) {
  const std::string text = ReadFile(path);
  if (const size_t place = FindTooDeep(text); place < text.size()) {
    ThrowInputError("{}: nested more than {} deep at byte {}", path.string(), kMaxJsonDepth, place);
  }
  try {
    return nlohmann::json::parse(text);
  } catch (const nlohmann::json::parse_error& error) {
    ThrowInputError("{}: not valid JSON near byte {}", path.string(), error.byte);
  } catch (const nlohmann::json::out_of_range&) {
    ThrowInputError("{}: has a number that is too large", path.string());
  }
}

std::string JsonText(const nlohmann::json& json) {
  return json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

void WriteJson(const std::filesystem::path& path, const nlohmann::json& json) {
  WriteFile(path, [&](std::ostream& stream) { stream << JsonText(json); });
}

}  // namespace s3lam
