#include "s3lam/io/image_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <string_view>

#include "jpeg_markers.h"
#include "png_mask.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

/// OpenCV pads a JPEG that is cut short with gray and says nothing.
void CheckComplete(std::string_view bytes, const std::string& source) {
  if (bytes.empty()) ThrowInputError("{}: image file is empty", source);
  if (internal::IsJpeg(bytes) && !internal::IsCompleteJpeg(bytes)) {
    ThrowInputError("{}: JPEG file is cut short at {} bytes", source, bytes.size());
  }
  if (bytes.starts_with("\x89PNG")) CheckPngIsComplete(bytes, source);
}

cv::Mat Decode(std::string_view bytes, int imread_flags, const std::string& source) {
  CheckComplete(bytes, source);
  if (bytes.size() > static_cast<size_t>(std::numeric_limits<int>::max())) {
    ThrowInputError("{}: image file of {} bytes is too large", source, bytes.size());
  }
  // The decoder only reads the buffer, but cv::Mat has no constant form.
  const cv::Mat buffer(1, static_cast<int>(bytes.size()), CV_8U, const_cast<char*>(bytes.data()));
  cv::Mat image;
  try {
    image = cv::imdecode(buffer, imread_flags | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& error) {
    ThrowInputError("{}: cannot decode image: {}", source, error.err);
  }
  if (image.empty()) ThrowInputError("{}: not an image, or damaged", source);
  return image;
}

std::optional<cv::Size> PngSize(std::string_view bytes) {
  // Signature (8 bytes), length and type of the header chunk (8), width (4), height (4).
  if (!bytes.starts_with("\x89PNG") || bytes.size() < 24) return std::nullopt;
  const auto big_endian = [&](size_t offset) {
    uint32_t value = 0;
    for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<uint8_t>(bytes[offset + i]);
    return static_cast<int>(value & 0x7FFFFFFF);
  };
  return cv::Size(big_endian(16), big_endian(20));
}

}  // namespace

cv::Mat ReadImageFile(const std::filesystem::path& path, int imread_flags) {
  return Decode(ReadFile(path), imread_flags, path.string());
}

cv::Size ReadImageSize(const std::filesystem::path& path) {
  const std::string bytes = ReadFile(path);
  if (const auto size = PngSize(bytes)) return *size;
  if (internal::IsJpeg(bytes)) {
    if (const auto size = internal::JpegSize(bytes)) return *size;
  }
  return Decode(bytes, cv::IMREAD_GRAYSCALE, path.string()).size();
}

bool HasImageExtension(const std::filesystem::path& path) {
  constexpr std::array<std::string_view, 9> kExtensions = {".jpg",  ".jpeg", ".png", ".bmp", ".tif",
                                                           ".tiff", ".webp", ".pgm", ".ppm"};
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end();
}

}  // namespace s3lam
