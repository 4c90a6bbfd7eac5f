#include "png_mask.h"

#include <libdeflate.h>

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <optional>

#include "image_decode.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

constexpr size_t kHeaderSize = 13;
constexpr size_t kColourType = 9;  // Place in the header.

}  // namespace

std::optional<std::string_view> FindPngChunk(std::string_view bytes, std::string_view type) {
  std::optional<std::string_view> found;
  ForEachPngChunk(bytes, [&](std::string_view candidate, std::string_view data) {
    if (candidate == type) found = data;
    return !found;
  });
  return found;
}

void CheckPngIsComplete(std::string_view bytes, const std::string& source) {
  if (bytes.substr(0, kPngSignature.size()) != kPngSignature) {
    ThrowInputError("{}: not a PNG file", source);
  }
  if (!FindPngChunk(bytes, "IEND")) {
    ThrowInputError("{}: PNG file is cut short at {} bytes", source, bytes.size());
  }
}

PngKind KindOfPng(std::string_view bytes) {
  const auto header = FindPngChunk(bytes, "IHDR");
  if (!header || header->size() != kHeaderSize) return {};
  return {static_cast<uint8_t>((*header)[8]), static_cast<uint8_t>((*header)[kColourType])};
}

std::string PaletteToGray(std::string_view bytes) {
  std::string result(kPngSignature);
  ForEachPngChunk(bytes, [&](std::string_view type, std::string_view data) {
    if (type != "IHDR" && type != "IDAT" && type != "IEND") return true;
    std::string chunk(data.data() - 8, data.size() + 12);
    if (type == "IHDR" && data.size() == kHeaderSize) {
      const auto checksum = [&] { return libdeflate_crc32(0, chunk.data() + 4, kHeaderSize + 4); };
      const size_t end = chunk.size() - 4;
      const bool is_sound = ReadBigEndian32(chunk, end) == checksum();
      chunk[8 + kColourType] = 0;
      for (size_t i = 0; is_sound && i < 4; ++i) {
        chunk[end + i] = static_cast<char>(checksum() >> (8 * (3 - i)) & 255U);
      }
    }
    result += chunk;
    return type != "IEND";
  });
  return result;
}

cv::Mat DecodePngMask(std::string_view bytes, const std::string& source) {
  CheckPngIsComplete(bytes, source);
  return internal::DecodeImage(bytes, cv::IMREAD_UNCHANGED, source);
}

cv::Mat ReadPngMask(const std::filesystem::path& path) {
  return DecodePngMask(ReadFile(path), path.string());
}

}  // namespace s3lam
