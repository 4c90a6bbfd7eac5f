#include "png_mask.h"

#include <cstdint>
#include <opencv2/imgcodecs.hpp>

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

}  // namespace

void CheckPngIsComplete(std::string_view bytes, const std::string& source) {
  if (bytes.substr(0, kPngSignature.size()) != kPngSignature) {
    ThrowInputError("{}: not a PNG file", source);
  }
  // A chunk is its length, a type of four letters, the data and a checksum.
  uint64_t offset = kPngSignature.size();
  while (offset + 12 <= bytes.size()) {
    const uint64_t end = offset + 12 + ReadBigEndian32(bytes, offset);
    if (end > bytes.size()) break;
    if (bytes.substr(offset + 4, 4) == "IEND") return;
    offset = end;
  }
  ThrowInputError("{}: PNG file is cut short at {} bytes", source, bytes.size());
}

cv::Mat ReadPngMask(const std::filesystem::path& path) {
  const std::string bytes = ReadFile(path);
  CheckPngIsComplete(bytes, path.string());
  const cv::Mat buffer(1, static_cast<int>(bytes.size()), CV_8U,
                       const_cast<char*>(bytes.data()));  // NOLINT: imdecode only reads it.
  cv::Mat image;
  try {
    image = cv::imdecode(buffer, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    ThrowInputError("{}: cannot decode PNG: {}", path.string(), error.err);
  }
  if (image.empty()) ThrowInputError("{}: damaged PNG file", path.string());
  return image;
}

}  // namespace s3lam
