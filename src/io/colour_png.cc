#include "colour_png.h"

#include <zlib.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <utility>
#include <vector>

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
  const auto checksum = crc32(0, reinterpret_cast<const Bytef*>(begin), 17);
  const PngHeader header{ReadBigEndian32(*chunk, 0), ReadBigEndian32(*chunk, 4)};
  if (ReadBigEndian32({chunk->data() + 13, 4}, 0) != checksum) return std::nullopt;
  const bool is_sane = header.width > 0 && header.width <= kMaxSide && header.height > 0 &&
                       header.height <= kMaxSide;
  return is_sane ? std::optional(header) : std::nullopt;
}

/// Inflates the image data of a file piece by piece.
class DataStream {
 public:
  explicit DataStream(std::string_view png) {
    ForEachPngChunk(png, [&](std::string_view type, std::string_view data) {
      if (type == "IDAT") chunks_.push_back(data);
      return type != "IEND";
    });
    is_open_ = inflateInit(&stream_) == Z_OK;
  }
  ~DataStream() {
    if (is_open_) inflateEnd(&stream_);
  }
  DataStream(const DataStream&) = delete;
  DataStream& operator=(const DataStream&) = delete;

  /// Bytes of compressed data.
  [[nodiscard]] size_t size() const {
    size_t sum = 0;
    for (const std::string_view chunk : chunks_) sum += chunk.size();
    return sum;
  }

  /// Fills the buffer; false if the data are damaged or end before.
  bool Read(std::vector<uint8_t>& buffer) {
    stream_.next_out = buffer.data();
    stream_.avail_out = static_cast<uInt>(buffer.size());
    while (stream_.avail_out > 0) {
      if (!Inflate()) return false;
    }
    return true;
  }

  /// True if nothing comes any more and the checksum fits.
  bool Finish() {
    uint8_t nothing = 0;
    stream_.next_out = &nothing;
    stream_.avail_out = 1;
    bool sound = true;
    while (sound && !is_finished_) sound = Inflate() && stream_.avail_out > 0;
    stream_.next_out = nullptr;
    return sound;
  }

 private:
  bool Inflate() {
    if (!is_open_ || is_finished_) return false;
    if (stream_.avail_in == 0 && next_chunk_ < chunks_.size()) {
      const std::string_view chunk = chunks_[next_chunk_++];
      // zlib only reads its input, but has no constant form.
      stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(chunk.data()));
      stream_.avail_in = static_cast<uInt>(chunk.size());
    }
    const int result = inflate(&stream_, Z_NO_FLUSH);
    is_finished_ = result == Z_STREAM_END;
    return is_finished_ || result == Z_OK ||
           (result == Z_BUF_ERROR && next_chunk_ < chunks_.size());
  }

  std::vector<std::string_view> chunks_;
  size_t next_chunk_ = 0;
  z_stream stream_{};
  bool is_open_ = false;
  bool is_finished_ = false;
};

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

/// Undoes the filter of a row (PNG 9.2); `bytes` begin with its type. False for an unknown one.
bool UnfilterRow(const uint8_t* bytes, const uint32_t* above, Eigen::Index width, uint32_t* row) {
  const uint8_t* in = bytes + 1;
  uint32_t left = 0;
  uint32_t up_left = 0;
  switch (bytes[0]) {
    case 0:
      for (Eigen::Index x = 0; x < width; ++x, in += 3) row[x] = LoadPixel(in);
      return true;
    case 1:
      for (Eigen::Index x = 0; x < width; ++x, in += 3) {
        row[x] = left = AddBytes(left, LoadPixel(in));
      }
      return true;
    case 2:
      for (Eigen::Index x = 0; x < width; ++x, in += 3) row[x] = AddBytes(above[x], LoadPixel(in));
      return true;
    case 3:
      for (Eigen::Index x = 0; x < width; ++x, in += 3) {
        row[x] = left = AddBytes(AverageBytes(left, above[x]), LoadPixel(in));
      }
      return true;
    case 4:
      for (Eigen::Index x = 0; x < width; ++x, in += 3) {
        row[x] = left = AddBytes(Paeth(left, above[x], up_left), LoadPixel(in));
        up_left = above[x];
      }
      return true;
    default:
      return false;
  }
}

}  // namespace

std::optional<SegmentImage> DecodeColourPng(std::string_view bytes) {
  constexpr size_t kMaxInflation = 1032;  // Of deflate.
  constexpr size_t kBlockBytes = size_t{1} << 16;
  const auto header = ReadHeader(bytes);
  if (!header) return std::nullopt;
  const Eigen::Index width = header->width;
  const size_t bytes_per_row = 1 + 3 * size_t{header->width};
  DataStream data(bytes);
  if (header->height * bytes_per_row > kMaxInflation * data.size()) return std::nullopt;
  SegmentImage pixels(header->height, width);
  const std::vector<uint32_t> zeros(header->width, 0);
  const uint32_t* above = zeros.data();
  std::vector<uint8_t> block;  // Rows that lie in the cache, and enough of them for zlib.
  const auto max_rows = static_cast<Eigen::Index>(1 + kBlockBytes / bytes_per_row);
  for (Eigen::Index begin = 0; begin < pixels.rows(); begin += max_rows) {
    const Eigen::Index rows = std::min(max_rows, pixels.rows() - begin);
    block.resize(static_cast<size_t>(rows) * bytes_per_row);
    if (!data.Read(block)) return std::nullopt;
    for (Eigen::Index i = 0; i < rows; ++i) {
      uint32_t* row = pixels.data() + (begin + i) * width;
      const uint8_t* source = block.data() + static_cast<size_t>(i) * bytes_per_row;
      if (!UnfilterRow(source, above, width, row)) return std::nullopt;
      above = row;
    }
  }
  return data.Finish() ? std::optional(std::move(pixels)) : std::nullopt;
}

}  // namespace s3lam
