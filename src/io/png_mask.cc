#include "png_mask.h"

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <optional>

#include "image_decode.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

constexpr std::string_view kPngSignature("\x89PNG\r\n\x1a\n", 8);

uint64_t ReadBigEndian32(std::string_view bytes, size_t offset) {
  uint64_t value = 0;
  for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<uint8_t>(bytes[offset + i]);
  return value;
}

/// Data of the first chunk of a type; empty if there is none. Nothing but the bytes is trusted.
std::optional<std::string_view> FindChunk(std::string_view bytes, std::string_view type) {
  // A chunk is its length, a type of four letters, the data and a checksum.
  uint64_t offset = kPngSignature.size();
  while (offset + 12 <= bytes.size()) {
    const uint64_t length = ReadBigEndian32(bytes, offset);
    if (offset + 12 + length > bytes.size()) break;
    if (bytes.substr(offset + 4, 4) == type) return bytes.substr(offset + 8, length);
    offset += 12 + length;
  }
  return std::nullopt;
}

}  // namespace

void CheckPngIsComplete(std::string_view bytes, const std::string& source) {
  if (bytes.substr(0, kPngSignature.size()) != kPngSignature) {
    ThrowInputError("{}: not a PNG file", source);
  }
  if (!FindChunk(bytes, "IEND")) {
    ThrowInputError("{}: PNG file is cut short at {} bytes", source, bytes.size());
  }
}

std::string_view PngPalette(std::string_view bytes) {
  constexpr size_t kColourType = 9;
  constexpr char kPalette = 3;
  const auto header = FindChunk(bytes, "IHDR");
  if (!header || header->size() <= kColourType || (*header)[kColourType] != kPalette) return {};
  return FindChunk(bytes, "PLTE").value_or(std::string_view());
}

cv::Mat DecodePngMask(std::string_view bytes, const std::string& source) {
  CheckPngIsComplete(bytes, source);
  return internal::DecodeImage(bytes, cv::IMREAD_UNCHANGED, source);
}

cv::Mat ReadPngMask(const std::filesystem::path& path) {
  return DecodePngMask(ReadFile(path), path.string());
}

}  // namespace s3lam
