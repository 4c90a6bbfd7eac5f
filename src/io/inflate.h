#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace s3lam {

enum class Wrapping {
  kNone,  // As in ZIP archives.
  kZlib,  // With a header and a checksum, as in PNG.
};

/// Unpacks deflated data (RFC 1951, 1950). Nothing if they are damaged or do not give exactly
/// `size` bytes; a size that no such data can give takes no memory. What follows the data is
/// ignored.
std::optional<std::string> Inflate(std::string_view packed, size_t size, Wrapping wrapping);

}  // namespace s3lam
