#include "png_mask.h"

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <optional>

#include "image_decode.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
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

std::string_view PngPalette(std::string_view bytes) {
  constexpr size_t kColourType = 9;
  constexpr char kPalette = 3;
  const auto header = FindPngChunk(bytes, "IHDR");
  if (!header || header->size() <= kColourType || (*header)[kColourType] != kPalette) return {};
  return FindPngChunk(bytes, "PLTE").value_or(std::string_view());
}

cv::Mat DecodePngMask(std::string_view bytes, const std::string& source) {
  CheckPngIsComplete(bytes, source);
  return internal::DecodeImage(bytes, cv::IMREAD_UNCHANGED, source);
}

cv::Mat ReadPngMask(const std::filesystem::path& path) {
  return DecodePngMask(ReadFile(path), path.string());
}

}  // namespace s3lam
