#include "image_header.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdlib>
#include <limits>

#include "jpeg_markers.h"
#include "png_mask.h"
#include "tiff.h"

namespace s3lam {
namespace {

using internal::Tiff;

// Deflate codes at most 258 bytes in 2 bits. JPEG spends a bit or more on a block of 64 pixels,
// which a subsampled channel spreads over a few times as many.
constexpr double kMaxDeflateRatio = 1032.0;
constexpr double kMaxJpegPixelsPerByte = 4096.0;
// Lossy WebP spends two bits or more on the modes of a block of 256 pixels.
constexpr double kMaxWebpPixelsPerByte = 1024.0;

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

/// Baseline and common tags and values of TIFF 6.0.
constexpr unsigned kTagWidth = 256;
constexpr unsigned kTagHeight = 257;
constexpr unsigned kTagBitsPerSample = 258;
constexpr unsigned kTagCompression = 259;
constexpr unsigned kTagTileWidth = 322;
constexpr unsigned kTagTileHeight = 323;

/// A width and a height of the first image of a TIFF; zero where there is none.
cv::Size TiffSides(const Tiff& tiff, size_t directory, unsigned width_tag, unsigned height_tag) {
  const auto side = [&](unsigned tag) {
    const double value = tiff.Value(directory, tag).value_or(0.0);
    return static_cast<int>(std::clamp<double>(value, 0.0, std::numeric_limits<int>::max()));
  };
  return {side(width_tag), side(height_tag)};
}

std::optional<cv::Size> TiffSize(const Tiff& tiff) {
  const auto directory = tiff.FirstDirectory();
  if (!directory) return std::nullopt;
  return TiffSides(tiff, *directory, kTagWidth, kTagHeight);
}

/// Pixels that a TIFF with an image of `num_pixels` stores at least: a tile is always whole.
uint64_t TiffPixels(const Tiff& tiff, uint64_t num_pixels) {
  const auto directory = tiff.FirstDirectory();
  if (!directory) return num_pixels;
  const cv::Size tile = TiffSides(tiff, *directory, kTagTileWidth, kTagTileHeight);
  return std::max(num_pixels,
                  static_cast<uint64_t>(tile.width) * static_cast<uint64_t>(tile.height));
}

/// Bits that a pixel of a TIFF takes at least: each has one sample or more. 0 where a compression
/// has no limit, as those of facsimiles.
double TiffBitsPerPixel(const Tiff& tiff) {
  const auto directory = tiff.FirstDirectory();
  if (!directory) return 0.0;
  const double sample_bits = tiff.Value(*directory, kTagBitsPerSample).value_or(1.0);
  switch (static_cast<int64_t>(tiff.Value(*directory, kTagCompression).value_or(1.0))) {
    case 1:
      return sample_bits;
    case 5:  // LZW: a code has 9 bits at least, and stands for fewer than 4096 bytes.
      return sample_bits * 9.0 / 8.0 / 4096.0;
    case 7:
      return 8.0 / kMaxJpegPixelsPerByte;
    case 8:
    case 32946:
      return sample_bits / kMaxDeflateRatio;
    case 32773:  // Runs of at most 128 bytes, in two.
      return sample_bits / 64.0;
    default:
      return 0.0;
  }
}

/// A WebP file begins with "RIFF", its size and "WEBP"; the name and size of a chunk follow, and
/// its data.
constexpr size_t kWebpChunkAt = 12;
constexpr size_t kWebpDataAt = 20;
constexpr size_t kWebpHeadersEnd = 30;

bool IsWebp(std::string_view bytes) {
  return bytes.starts_with("RIFF") && bytes.size() >= kWebpHeadersEnd &&
         bytes.substr(8, 4) == "WEBP";
}

bool IsLossyWebp(std::string_view bytes) { return bytes.substr(kWebpChunkAt, 4) == "VP8 "; }

std::optional<cv::Size> WebpSize(std::string_view bytes) {
  const std::string_view chunk = bytes.substr(kWebpChunkAt, 4);
  const auto number = [&](size_t offset, size_t count) {
    return static_cast<int>(LittleEndian(bytes, kWebpDataAt + offset, count));
  };
  constexpr int kSideMask = (1 << 14) - 1;
  // A tag of 3 bytes and a start code of 3, then both sides with two bits of scaling above.
  if (IsLossyWebp(bytes)) return cv::Size(number(6, 2) & kSideMask, number(8, 2) & kSideMask);
  // One byte of signature, then both sides less one.
  if (chunk == "VP8L") {
    return cv::Size((number(1, 4) & kSideMask) + 1, (number(2, 3) >> 6 & kSideMask) + 1);
  }
  // Four bytes of flags, then both sides less one.
  if (chunk == "VP8X") return cv::Size(number(4, 3) + 1, number(7, 3) + 1);
  return std::nullopt;
}

}  // namespace

std::optional<cv::Size> internal::ClaimedSize(std::string_view bytes) {
  if (IsJpeg(bytes)) return JpegSize(bytes);
  if (const auto size = PngSize(bytes)) return size;
  if (const auto size = BmpSize(bytes)) return size;
  if (const Tiff tiff(bytes); tiff.IsTiff()) return TiffSize(tiff);
  if (IsWebp(bytes)) return WebpSize(bytes);
  return PnmSize(bytes);
}

uint64_t internal::LeastFileSize(std::string_view bytes, uint64_t num_pixels) {
  const auto of_bits = [&](double bits_per_pixel) {
    return static_cast<uint64_t>(static_cast<double>(num_pixels) * bits_per_pixel / 8.0);
  };
  if (IsJpeg(bytes)) return of_bits(8.0 / kMaxJpegPixelsPerByte);
  if (IsBmp(bytes)) return of_bits(BmpBitsPerPixel(bytes));
  if (const Tiff tiff(bytes); tiff.IsTiff()) {
    num_pixels = TiffPixels(tiff, num_pixels);
    return of_bits(TiffBitsPerPixel(tiff));
  }
  if (IsWebp(bytes)) return IsLossyWebp(bytes) ? of_bits(8.0 / kMaxWebpPixelsPerByte) : 0;
  if (PnmSize(bytes)) return of_bits(PnmBitsPerPixel(bytes));
  return of_bits(static_cast<double>(PngBitsPerPixel(bytes)) / kMaxDeflateRatio);
}

}  // namespace s3lam
