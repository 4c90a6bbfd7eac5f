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

/// Bits of a pixel of a PNG before compression; 1, the least, if the header is not valid.
uint64_t PngBitsPerPixel(std::string_view bytes) {
  constexpr std::array<uint64_t, 7> kChannels = {1, 1, 3, 1, 2, 1, 4};  // By colour type.
  constexpr size_t kBitDepthAt = 24;
  constexpr size_t kColourTypeAt = 25;
  if (bytes.size() <= kColourTypeAt) return 1;
  const auto bit_depth = static_cast<uint8_t>(bytes[kBitDepthAt]);
  const auto colour_type = static_cast<uint8_t>(bytes[kColourTypeAt]);
  if (bit_depth == 0 || bit_depth > 16 || colour_type >= kChannels.size()) return 1;
  return kChannels[colour_type] * bit_depth;
}

/// `count` bytes at an offset that is within the file, the least significant first.
uint32_t LittleEndian(std::string_view bytes, size_t offset, size_t count) {
  uint32_t value = 0;
  for (size_t i = count; i-- > 0;) value = value << 8 | static_cast<uint8_t>(bytes[offset + i]);
  return value;
}

/// Where the headers of a BMP have what is needed here; that of OS/2 is older and shorter.
constexpr size_t kBmpHeaderSizeAt = 14;
constexpr size_t kBmpCompressionAt = 30;
constexpr size_t kBmpHeadersEnd = 34;
constexpr uint32_t kOldBmpHeaderSize = 12;

bool IsBmp(std::string_view bytes) {
  return bytes.starts_with("BM") && bytes.size() >= kBmpHeadersEnd;
}

bool IsOldBmp(std::string_view bytes) {
  return LittleEndian(bytes, kBmpHeaderSizeAt, 4) == kOldBmpHeaderSize;
}

std::optional<cv::Size> BmpSize(std::string_view bytes) {
  if (!IsBmp(bytes)) return std::nullopt;
  if (IsOldBmp(bytes)) {
    return cv::Size(static_cast<int>(LittleEndian(bytes, 18, 2)),
                    static_cast<int>(LittleEndian(bytes, 20, 2)));
  }
  const auto magnitude = [&](size_t offset) {  // Negative heights are of images from above.
    const auto value = static_cast<int32_t>(LittleEndian(bytes, offset, 4));
    return std::abs(std::max(value, -std::numeric_limits<int>::max()));
  };
  return cv::Size(magnitude(18), magnitude(22));
}

/// Bits that a pixel of a BMP takes at least: of run lengths, four bytes can skip 255 x 255 pixels.
double BmpBitsPerPixel(std::string_view bytes) {
  constexpr uint32_t kRunLengths8 = 1;
  constexpr uint32_t kRunLengths4 = 2;
  if (IsOldBmp(bytes)) return LittleEndian(bytes, 24, 2);
  const uint32_t compression = LittleEndian(bytes, kBmpCompressionAt, 4);
  if (compression == kRunLengths8 || compression == kRunLengths4) return 32.0 / (255.0 * 255.0);
  return LittleEndian(bytes, 28, 2);
}

/// Of a PBM, PGM or PPM, as OpenCV reads them: one character after a number is passed over,
/// whatever it is.
std::optional<cv::Size> PnmSize(std::string_view bytes) {
  if (bytes.size() < 3 || bytes[0] != 'P' || bytes[1] < '1' || bytes[1] > '6') return std::nullopt;
  size_t at = 2;
  const auto is = [&](int (*is_of_kind)(int)) {
    return at < bytes.size() && is_of_kind(static_cast<unsigned char>(bytes[at])) != 0;
  };
  const auto read_number = [&] {
    while (is(std::isspace) || (at < bytes.size() && bytes[at] == '#')) {
      at = bytes[at] == '#' ? std::min(bytes.find_first_of("\r\n", at), bytes.size()) : at + 1;
    }
    int64_t value = 0;
    for (; is(std::isdigit); ++at) {
      value = std::min<int64_t>(10 * value + (bytes[at] - '0'), std::numeric_limits<int>::max());
    }
    ++at;
    return static_cast<int>(value);
  };
  const int width = read_number();
  return cv::Size(width, read_number());
}

double PnmBitsPerPixel(std::string_view bytes) {
  if (bytes[1] == '4') return 1.0;
  return bytes[1] == '6' ? 24.0 : 8.0;  // Of a text, one character at least.
}

/// What the header says, where it is one that is read here: not of TIFF and WebP.
std::optional<cv::Size> ClaimedSize(std::string_view bytes) {
  if (internal::IsJpeg(bytes)) return internal::JpegSize(bytes);
  if (const auto size = PngSize(bytes)) return size;
  if (const auto size = BmpSize(bytes)) return size;
  return PnmSize(bytes);
}

/// The least that a file with this many pixels has to have [bytes].
uint64_t LeastFileSize(std::string_view bytes, uint64_t num_pixels) {
  // Deflate codes at most 258 bytes in 2 bits. JPEG spends a bit or more on a block of 64 pixels,
  // which a subsampled channel spreads over a few times as many.
  constexpr uint64_t kMaxPngRatio = 1032;
  constexpr uint64_t kMaxJpegPixelsPerByte = 4096;
  if (internal::IsJpeg(bytes)) return num_pixels / kMaxJpegPixelsPerByte;
  const auto of_bits = [&](double bits_per_pixel) {
    return static_cast<uint64_t>(static_cast<double>(num_pixels) * bits_per_pixel / 8.0);
  };
  if (IsBmp(bytes)) return of_bits(BmpBitsPerPixel(bytes));
  if (PnmSize(bytes)) return of_bits(PnmBitsPerPixel(bytes));
  return num_pixels * PngBitsPerPixel(bytes) / 8 / kMaxPngRatio;
}

/// Holds what a header claims against the size of the file, before a decoder takes the memory.
void CheckClaimedSize(std::string_view bytes, const std::string& source) {
  constexpr uint64_t kMaxPixels = 1 << 30;  // OpenCV's own limit.
  const std::optional<cv::Size> size = ClaimedSize(bytes);
  if (!size) return;
  const uint64_t num_pixels =
      static_cast<uint64_t>(size->width) * static_cast<uint64_t>(size->height);
  if (num_pixels > kMaxPixels) {
    ThrowInputError("{}: an image of {} x {} px is too large (at most 2^30 px)", source,
                    size->width, size->height);
  }
  if (LeastFileSize(bytes, num_pixels) > bytes.size()) {
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
