#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <string_view>

namespace s3lam {

inline constexpr std::string_view kPngSignature("\x89PNG\r\n\x1a\n", 8);

inline uint32_t ReadBigEndian32(std::string_view bytes, size_t offset) {
  uint32_t value = 0;
  for (size_t i = 0; i < 4; ++i) value = value << 8U | static_cast<uint8_t>(bytes[offset + i]);
  return value;
}

/// Calls visit(type, data) for the chunks of a PNG one by one, as long as it returns true and they
/// lie within the bytes. Nothing but the bytes is trusted; checksums are not looked at.
template <typename Visit>
void ForEachPngChunk(std::string_view bytes, const Visit& visit) {
  // A chunk is its length, a type of four letters, the data and a checksum.
  uint64_t offset = kPngSignature.size();
  while (offset + 12 <= bytes.size()) {
    const uint64_t length = ReadBigEndian32(bytes, offset);
    if (offset + 12 + length > bytes.size()) return;
    if (!visit(bytes.substr(offset + 4, 4), bytes.substr(offset + 8, length))) return;
    offset += 12 + length;
  }
}

/// Data of the first chunk of a type; empty if there is none.
std::optional<std::string_view> FindPngChunk(std::string_view bytes, std::string_view type);

/// Throws InputError naming `source` unless `bytes` is a PNG file that is complete, that is whose
/// chunks lead to the end chunk. (Their checksums are the decoder's business.)
void CheckPngIsComplete(std::string_view bytes, const std::string& source);

/// How a PNG stores its pixels; zeros if its header is not there.
struct PngKind {
  int bits = 0;  // Per sample.
  int colour_type = 0;
};
inline constexpr int kPngPalette = 3;  // A colour type.
PngKind KindOfPng(std::string_view bytes);

/// A PNG with a palette as one in gray, whose pixels are the indices.
std::string PaletteToGray(std::string_view bytes);

/// Decodes a PNG as it is stored: depth and channels unchanged (colour as BGR). Throws InputError
/// naming `source` if it is cut short or damaged.
cv::Mat DecodePngMask(std::string_view bytes, const std::string& source);

/// The same from a file, which may be missing as well.
cv::Mat ReadPngMask(const std::filesystem::path& path);

}  // namespace s3lam
