// Colour masks are read through PanopticMasks, whose KITTI-STEP ids are the colours.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <libdeflate.h>

#include <array>
#include <cstdlib>
#include <string>

#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"
#include "s3lam/io/panoptic_masks.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using testing::TempDir;

constexpr int kWidth = 83;
constexpr int kHeight = 100;

/// Every label is a class of stuff.
ClassTable Table() {
  ClassTable table{"test", {}};
  for (int label = 0; label < 256; ++label) {
    table.classes.push_back({label,
                             "c" + std::to_string(label),
                             false,
                             false,
                             false,
                             50,
                             SurfaceOrientation::kAny,
                             {}});
  }
  return table;
}

/// Colours, black among them, in runs that are short in every third row and long in the others;
/// most runs repeat the row above.
SegmentImage MakePixels() {
  Rng rng(3);
  SegmentImage pixels(kHeight, kWidth);
  for (int y = 0; y < kHeight; ++y) {
    const uint64_t mean_run = y % 3 == 0 ? 2 : 20;
    bool repeat_above = false;
    uint32_t colour = 0;
    for (int x = 0; x < kWidth; ++x) {
      if (x == 0 || rng.Below(mean_run) == 0) {
        repeat_above = y > 0 && rng.Below(3) > 0;
        colour = rng.Below(5) == 0 ? 0 : static_cast<uint32_t>(rng.Below(1U << 24));
      }
      pixels(y, x) = repeat_above ? pixels(y - 1, x) : colour;
    }
  }
  return pixels;
}

int ByteOf(const SegmentImage& pixels, int x, int y, int channel) {
  return x < 0 || y < 0 ? 0 : static_cast<int>(pixels(y, x) >> (8 * channel) & 255U);
}

/// What a filter of the PNG specification (9.2) predicts of a byte.
int Predict(int filter, int left, int up, int up_left) {
  const int p = left + up - up_left;
  switch (filter) {
    case 1:
      return left;
    case 2:
      return up;
    case 3:
      return (left + up) / 2;
    case 4:
      if (std::abs(p - left) <= std::abs(p - up) && std::abs(p - left) <= std::abs(p - up_left)) {
        return left;
      }
      return std::abs(p - up) <= std::abs(p - up_left) ? up : up_left;
    default:
      return 0;
  }
}

/// The rows, filtered by `filter`, or if that is negative by each filter in turn.
std::string FilterRows(const SegmentImage& pixels, int filter) {
  std::string rows;
  for (int y = 0; y < kHeight; ++y) {
    const int type = filter >= 0 ? filter : y % 5;
    rows += static_cast<char>(type);
    for (int x = 0; x < kWidth; ++x) {
      for (int c = 0; c < 3; ++c) {
        const int predicted = Predict(type, ByteOf(pixels, x - 1, y, c),
                                      ByteOf(pixels, x, y - 1, c), ByteOf(pixels, x - 1, y - 1, c));
        rows += static_cast<char>(ByteOf(pixels, x, y, c) - predicted);
      }
    }
  }
  return rows;
}

std::string BigEndian(size_t value) {
  std::string bytes;
  for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift & 255U);
  return bytes;
}

std::string Chunk(const std::string& type, const std::string& data) {
  const std::string body = type + data;
  const uint32_t checksum = libdeflate_crc32(0, body.data(), body.size());
  return BigEndian(data.size()) + body + BigEndian(checksum);
}

/// A PNG of filtered rows, its data in three chunks, one of them empty.
std::string MakePng(const std::string& rows) {
  constexpr int kLevel = 6;
  libdeflate_compressor* compressor = libdeflate_alloc_compressor(kLevel);
  std::string data(libdeflate_zlib_compress_bound(compressor, rows.size()), '\0');
  const size_t size =
      libdeflate_zlib_compress(compressor, rows.data(), rows.size(), data.data(), data.size());
  libdeflate_free_compressor(compressor);
  data.resize(size);
  const std::string kind("\x08\x02\x00\x00\x00", 5);
  return "\x89PNG\r\n\x1a\n" + Chunk("IHDR", BigEndian(kWidth) + BigEndian(kHeight) + kind) +
         Chunk("IDAT", data.substr(0, 70)) + Chunk("IDAT", "") + Chunk("IDAT", data.substr(70)) +
         Chunk("IEND", "");
}

class ColourPng : public ::testing::Test {
 protected:
  [[nodiscard]] SegmentImage Read(const std::string& png) const {
    dir_.Write("masks/a.png", png);
    return PanopticMasks(dir_ / "masks", MaskFormat::kKittiStep, {}, Table()).Read(0).segment_ids;
  }

  TempDir dir_;
};

TEST_F(ColourPng, UndoesEveryFilter) {
  const SegmentImage pixels = MakePixels();
  for (int filter = -1; filter <= 4; ++filter) {
    EXPECT_EQ(Read(MakePng(FilterRows(pixels, filter))), pixels) << "filter " << filter;
  }
}

TEST_F(ColourPng, RefusesDamagedFiles) {
  const std::string rows = FilterRows(MakePixels(), -1);
  EXPECT_THROW((void)Read(MakePng(rows.substr(0, rows.size() / 2))), InputError);  // Rows missing.
  std::string unknown_filter = rows;
  unknown_filter[0] = 9;
  EXPECT_THROW((void)Read(MakePng(unknown_filter)), InputError);
}

}  // namespace
}  // namespace s3lam
