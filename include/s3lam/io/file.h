#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace s3lam {

/// The whole file. Throws InputError naming the path if it cannot be read.
std::string ReadFile(const std::filesystem::path& path);

/// Writes through `body` to a stream in the classic locale; throws std::runtime_error naming the
/// path if anything fails, a full disk included.
void WriteFile(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body);

/// Throws InputError naming the path, and where parsing stopped.
nlohmann::json ReadJson(const std::filesystem::path& path);

/// Two-space indented, ending in a newline.
void WriteJson(const std::filesystem::path& path, const nlohmann::json& json);

}  // namespace s3lam
