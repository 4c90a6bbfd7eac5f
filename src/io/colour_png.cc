#include "colour_png.h"

#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "inflate.h"
#include "png_mask.h"

namespace s3lam {
namespace {

struct PngHeader {
  uint32_t width = 0;
  uint32_t height = 0;
};

/// The header of a file of the kind that is decoded here.
std::optional<PngHeader> ReadHeader(std::string_view bytes) {
  // Bits, colour type, compression, filters, interlacing.
  constexpr std::string_view kKind("\x08\x02\x00\x00\x00", 5);
  constexpr uint32_t kMaxSide = 1U << 16;
  const auto chunk = FindPngChunk(bytes, "IHDR");
  if (!chunk || chunk->size() != 13 || chunk->substr(8) != kKind) return std::nullopt;
  const char* begin = chunk->data() - 4;  // The checksum is over the type as well.
  const uint32_t checksum = libdeflate_crc32(0, begin, 17);
  const PngHeader header{ReadBigEndian32(*chunk, 0), ReadBigEndian32(*chunk, 4)};
  if (ReadBigEndian32({chunk->data() + 13, 4}, 0) != checksum) return std::nullopt;
  const bool is_sane = header.width > 0 && header.width <= kMaxSide && header.height > 0 &&
                       header.height <= kMaxSide;
  return is_sane ? std::optional(header) : std::nullopt;
}

/// The compressed image data of a file, which may come in many chunks.
std::string ImageDataOf(std::string_view png) {
  std::string data;
  ForEachPngChunk(png, [&](std::string_view type, std::string_view chunk) {
    if (type == "IDAT") data += chunk;
    return type != "IEND";
  });
  return data;
}

/// A pixel's three bytes in one word, the first one lowest.
uint32_t LoadPixel(const uint8_t* bytes) {
  return static_cast<uint32_t>(bytes[0]) | static_cast<uint32_t>(bytes[1]) << 8U |
         static_cast<uint32_t>(bytes[2]) << 16U;
}

/// Byte by byte, without carry from one to the next.
uint32_t AddBytes(uint32_t a, uint32_t b) {
  constexpr uint32_t kLow = 0x7f7f7f7fU;
  return ((a & kLow) + (b & kLow)) ^ ((a ^ b) & ~kLow);
}
uint32_t AverageBytes(uint32_t a, uint32_t b) {
  constexpr uint32_t kHigh = 0xfefefefeU;
  return (a & b) + (((a ^ b) & kHigh) >> 1U);
}

/// Which of left, up and up-left is nearest to left + up - up-left, byte by byte (PNG 9.4).
uint32_t Paeth(uint32_t left, uint32_t up, uint32_t up_left) {
  if (left == up_left) return up;  // Within segments this is all.
  if (up == up_left) return left;
  uint32_t result = 0;
  for (uint32_t shift = 0; shift < 24; shift += 8) {
    const auto byte = [shift](uint32_t x) { return static_cast<int>(x >> shift & 0xffU); };
    const int a = byte(left);
    const int b = byte(up);
    const int c = byte(up_left);
    const int to_a = std::abs(b - c);
    const int to_b = std::abs(a - c);
    const int to_c = std::abs(a + b - 2 * c);
    const int nearest = to_a <= to_b && to_a <= to_c ? a : (to_b <= to_c ? b : c);
    result |= static_cast<uint32_t>(nearest) << shift;
  }
  return result;
}

/// Pixels of a row that are looked at together.
constexpr Eigen::Index kRun = 8;

/// Are all bytes of a run of pixels zero?
bool IsZeroRun(const uint8_t* bytes) {
  std::array<uint64_t, 3> words;
  static_assert(sizeof(words) == 3 * kRun);
  std::memcpy(words.data(), bytes, sizeof(words));
  return (words[0] | words[1] | words[2]) == 0;
}

/// Calls for_pixel(x, its three bytes) for the pixels of a row from the left, but for_zeros(x) for
/// a whole run of pixels of zeros, as they are within segments; where that returns false, the run
/// is handed over pixel by pixel.
template <typename ForZeros, typename ForPixel>
void ForEachPixel(const uint8_t* bytes, Eigen::Index width, const ForZeros& for_zeros,
                  const ForPixel& for_pixel) {
  for (Eigen::Index x = 0; x < width;) {
    if (x + kRun <= width && IsZeroRun(bytes + 3 * x) && for_zeros(x)) {
      x += kRun;
      continue;
    }
    for (const Eigen::Index end = std::min(width, x + kRun); x < end; ++x) {
      for_pixel(x, LoadPixel(bytes + 3 * x));
    }
  }
}

/// Undoes the filter of a row (PNG 9.2); `bytes` begin with its type. False for an unknown one.
bool UnfilterRow(const uint8_t* bytes, const uint32_t* above, Eigen::Index width, uint32_t* row) {
  uint32_t left = 0;
  uint32_t up_left = 0;
  const auto fill_with_left = [&](Eigen::Index x) {
    std::fill_n(row + x, kRun, left);
    return true;
  };
  const auto copy_from_above = [&](Eigen::Index x) {
    std::copy_n(above + x, kRun, row + x);
    return true;
  };
  switch (bytes[0]) {
    case 0:  // Nothing: `left` stays zero.
      ForEachPixel(bytes + 1, width, fill_with_left,
                   [&](Eigen::Index x, uint32_t pixel) { row[x] = pixel; });
      return true;
    case 1:
      ForEachPixel(bytes + 1, width, fill_with_left,
                   [&](Eigen::Index x, uint32_t pixel) { row[x] = left = AddBytes(left, pixel); });
      return true;
    case 2:
      ForEachPixel(bytes + 1, width, copy_from_above,
                   [&](Eigen::Index x, uint32_t pixel) { row[x] = AddBytes(above[x], pixel); });
      return true;
    case 3:
      ForEachPixel(
          bytes + 1, width, [](Eigen::Index /*x*/) { return false; },
          [&](Eigen::Index x, uint32_t pixel) {
            row[x] = left = AddBytes(AverageBytes(left, above[x]), pixel);
          });
      return true;
    case 4:
      ForEachPixel(
          bytes + 1, width,
          [&](Eigen::Index x) {  // Under a run of one colour, Paeth() is the pixel to the left.
            const bool is_one_colour = std::all_of(above + x, above + x + kRun,
                                                   [&](uint32_t up) { return up == up_left; });
            return is_one_colour && fill_with_left(x);
          },
          [&](Eigen::Index x, uint32_t pixel) {
            row[x] = left = AddBytes(Paeth(left, above[x], up_left), pixel);
            up_left = above[x];
          });
      return true;
    default:
      return false;
  }
}

}  // namespace

std::optional<SegmentImage> DecodeColourPng(std::string_view bytes) {
  const auto header = ReadHeader(bytes);
  if (!header) return std::nullopt;
  const Eigen::Index width = header->width;
  const size_t bytes_per_row = 1 + 3 * size_t{header->width};
  const auto rows = Inflate(ImageDataOf(bytes), header->height * bytes_per_row, Wrapping::kZlib);
  if (!rows) return std::nullopt;
  SegmentImage pixels(header->height, width);
  const std::vector<uint32_t> zeros(header->width, 0);
  const uint32_t* above = zeros.data();
  const char* source = rows->data();
  for (Eigen::Index y = 0; y < pixels.rows(); ++y, source += bytes_per_row) {
    uint32_t* row = pixels.data() + y * width;
    if (!UnfilterRow(reinterpret_cast<const uint8_t*>(source), above, width, row)) {
      return std::nullopt;
    }
    above = row;
  }
  return pixels;
}

}  // namespace s3lam
