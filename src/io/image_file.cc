#include "s3lam/io/image_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <limits>
#include <new>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "image_decode.h"
#include "jpeg_markers.h"
#include "png_mask.h"
#include "s3lam/base/error.h"
#include "s3lam/base/memory.h"
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

std::optional<cv::Size> PngSize(std::string_view bytes) {
  // Signature (8 bytes), length and type of the header chunk (8), width (4), height (4).
  if (!bytes.starts_with("\x89PNG") || bytes.size() < 24) return std::nullopt;
  constexpr uint32_t kMaxInt = std::numeric_limits<int>::max();
  const auto big_endian = [&](size_t offset) {
    uint32_t value = 0;
    for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<uint8_t>(bytes[offset + i]);
    return static_cast<int>(std::min(value, kMaxInt));
  };
  return cv::Size(big_endian(16), big_endian(20));
}

/// Bytes that the pixels of a PNG take before compression.
uint64_t PngRawSize(std::string_view bytes, cv::Size size) {
  constexpr std::array<uint64_t, 7> kChannels = {1, 1, 3, 1, 2, 1, 4};  // By colour type.
  if (bytes.size() < 26) return 0;
  const auto bit_depth = static_cast<uint8_t>(bytes[24]);
  const auto colour_type = static_cast<uint8_t>(bytes[25]);
  if (bit_depth > 16 || colour_type >= kChannels.size()) return 0;  // The decoder refuses it.
  const auto width = static_cast<uint64_t>(size.width);
  return static_cast<uint64_t>(size.height) * (width * kChannels[colour_type] * bit_depth / 8);
}

/// Holds what a header claims against the size of the file, before a decoder takes the memory.
void CheckClaimedSize(std::string_view bytes, const std::string& source) {
  // Deflate codes at most 258 bytes in 2 bits. JPEG spends a bit or more on a block of 64 pixels,
  // which a subsampled channel spreads over a few times as many.
  constexpr uint64_t kMaxPngRatio = 1032;
  constexpr uint64_t kMaxJpegPixelsPerByte = 4096;
  std::optional<cv::Size> size;
  uint64_t least_bytes = 0;
  if ((size = PngSize(bytes))) {
    least_bytes = PngRawSize(bytes, *size) / kMaxPngRatio;
  } else if (internal::IsJpeg(bytes) && (size = internal::JpegSize(bytes))) {
    least_bytes = static_cast<uint64_t>(size->width) * static_cast<uint64_t>(size->height) /
                  kMaxJpegPixelsPerByte;
  }
  if (!size) return;
  if (least_bytes > bytes.size()) {
    ThrowInputError("{}: {} bytes cannot be an image of {} x {} px: damaged", source, bytes.size(),
                    size->width, size->height);
  }
  constexpr uint64_t kBytesPerPixel = 4;
  const uint64_t num_pixels =
      static_cast<uint64_t>(size->width) * static_cast<uint64_t>(size->height);
  RequireMemory(kBytesPerPixel * num_pixels,
                fmt::format("{}: an image of {} x {} px", source, size->width, size->height));
}

}  // namespace

cv::Mat internal::DecodeImage(std::string_view bytes, int imread_flags, const std::string& source) {
  CheckComplete(bytes, source);
  if (bytes.size() > static_cast<size_t>(std::numeric_limits<int>::max())) {
    ThrowInputError("{}: image file of {} bytes is too large", source, bytes.size());
  }
  CheckClaimedSize(bytes, source);
  // The decoder only reads the buffer, but cv::Mat has no constant form.
  const cv::Mat buffer(1, static_cast<int>(bytes.size()), CV_8U, const_cast<char*>(bytes.data()));
  cv::Mat image;
  try {
    image = cv::imdecode(buffer, imread_flags | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& error) {
    if (error.code == cv::Error::StsNoMem) throw std::bad_alloc();
    ThrowInputError("{}: cannot decode image: {}", source, error.err);
  }
  if (image.empty()) ThrowInputError("{}: not an image, or damaged", source);
  return image;
}

cv::Mat ReadImageFile(const std::filesystem::path& path, int imread_flags) {
  return internal::DecodeImage(ReadFile(path), imread_flags, path.string());
}

cv::Size ReadImageSize(const std::filesystem::path& path) {
  const std::string bytes = ReadFile(path);
  if (const auto size = PngSize(bytes)) return *size;
  if (internal::IsJpeg(bytes)) {
    if (const auto size = internal::JpegSize(bytes)) return *size;
  }
  return internal::DecodeImage(bytes, cv::IMREAD_GRAYSCALE, path.string()).size();
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
