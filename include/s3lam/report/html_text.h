#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <string_view>

namespace s3lam {

/// The text with every byte that is not part of valid UTF-8 (file names may hold any) replaced by
/// U+FFFD.
std::string ValidUtf8(std::string_view text);

/// Valid UTF-8 in which no character means anything to HTML, in element content and in quoted
/// attributes.
std::string EscapeHtml(std::string_view text);

/// JSON that can stand within <script>: nothing in it can end the element.
std::string JsonForScript(const nlohmann::json& json);

std::string Base64(std::string_view bytes);

/// The bytes of an array of numbers, little-endian as the page's scripts expect.
template <typename T>
std::string Base64OfArray(std::span<const T> values) {
  return Base64({reinterpret_cast<const char*>(values.data()), values.size_bytes()});
}

}  // namespace s3lam
