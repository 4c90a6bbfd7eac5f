#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace s3lam {

/// The whole file. Throws InputError naming the path if it cannot be read.
std::string ReadFile(const std::filesystem::path& path);
/// What is left of a stream. Throws InputError naming `source` if it cannot be read.
std::string ReadStream(std::istream& stream, const std::string& source);

/// Writes through `body` to a stream in the classic locale; throws std::runtime_error naming the
/// path if anything fails, a full disk included.
void WriteFile(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body);

/// True for a name that stays in the folder it is relative to, and on one line: not empty, not
/// absolute, no "..", no line break or zero byte. Other bytes are the file system's business: a
/// name need not be UTF-8, and is made so where it is written into JSON.
bool IsNameWithin(std::string_view name);

/// Throws InputError naming the path, and where parsing stopped: not JSON, a number too large for a
/// double, lists and objects nested deeper than 64.
nlohmann::json ReadJson(const std::filesystem::path& path);

/// Two-space indented, ending in a newline. What is not UTF-8, as names of files may be, is made
/// so.
std::string JsonText(const nlohmann::json& json);
void WriteJson(const std::filesystem::path& path, const nlohmann::json& json);

}  // namespace s3lam
