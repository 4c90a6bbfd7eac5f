#include "s3lam/io/image_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdlib>
#include <limits>
#include <new>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "image_decode.h"
#include "image_header.h"
#include "jpeg_markers.h"
#include "png_mask.h"
#include "s3lam/base/error.h"
#include "s3lam/base/memory.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

/// Of the formats that HasImageExtension names. OpenCV may be built with decoders of very different
/// things, medical images and maps among them, some of which end the program over a damaged file or
/// open others that it refers to: they must not come into play by what a file begins with.
bool HasImageSignature(std::string_view bytes) {
  using std::string_view_literals::operator""sv;
  constexpr std::array kSignatures = {"\xff\xd8"sv, "\x89PNG"sv, "BM"sv, "II*\0"sv, "MM\0*"sv,
                                      "II+\0"sv,    "MM\0+"sv,   "P1"sv, "P2"sv,    "P3"sv,
                                      "P4"sv,       "P5"sv,      "P6"sv};
  constexpr size_t kDicomAt = 128;  // OpenCV takes it for DICOM, whatever it begins with.
  if (bytes.size() > kDicomAt && bytes.substr(kDicomAt, 4) == "DICM") return false;
  if (bytes.starts_with("RIFF") && bytes.size() > 12) return bytes.substr(8, 4) == "WEBP";
  return std::any_of(kSignatures.begin(), kSignatures.end(),
                     [&](std::string_view signature) { return bytes.starts_with(signature); });
}

/// OpenCV pads a JPEG that is cut short with gray and says nothing.
void CheckComplete(std::string_view bytes, const std::string& source) {
  if (bytes.empty()) ThrowInputError("{}: image file is empty", source);
  if (!HasImageSignature(bytes)) {
    ThrowInputError(
        "{}: not an image, or damaged: JPEG, PNG, BMP, TIFF, WebP, PGM and PPM are known", source);
  }
  if (internal::IsJpeg(bytes) && !internal::IsCompleteJpeg(bytes)) {
    ThrowInputError("{}: JPEG file is cut short at {} bytes", source, bytes.size());
  }
  if (bytes.starts_with("\x89PNG")) CheckPngIsComplete(bytes, source);
}

/// Holds what a header claims against the size of the file, before a decoder takes the memory.
void CheckClaimedSize(std::string_view bytes, const std::string& source) {
  constexpr uint64_t kMaxPixels = 1 << 30;  // OpenCV's own limit.
  const std::optional<cv::Size> size = internal::ClaimedSize(bytes);
  if (!size) return;
  const uint64_t num_pixels =
      static_cast<uint64_t>(size->width) * static_cast<uint64_t>(size->height);
  if (num_pixels > kMaxPixels) {
    ThrowInputError("{}: an image of {} x {} px is too large (at most 2^30 px)", source,
                    size->width, size->height);
  }
  if (internal::LeastFileSize(bytes, num_pixels) > bytes.size()) {
    ThrowInputError("{}: {} bytes cannot be an image of {} x {} px: damaged", source, bytes.size(),
                    size->width, size->height);
  }
  constexpr uint64_t kBytesPerPixel = 4;
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

void PrepareImageDecoders() {
  constexpr uint64_t kNeeded = 8ULL << 20;  // Several times what they take.
  if (AvailableMemory() < kNeeded) throw std::bad_alloc();
  constexpr int kSomeBytes = 16;
  (void)cv::imdecode(cv::Mat::zeros(1, kSomeBytes, CV_8U), cv::IMREAD_GRAYSCALE);
}

cv::Mat ReadImageFile(const std::filesystem::path& path, int imread_flags) {
  return internal::DecodeImage(ReadFile(path), imread_flags, path.string());
}

cv::Size ReadImageSize(const std::filesystem::path& path) {
  const std::string bytes = ReadFile(path);
  if (bytes.starts_with("\x89PNG") || internal::IsJpeg(bytes)) {
    if (const auto size = internal::ClaimedSize(bytes)) return *size;
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
