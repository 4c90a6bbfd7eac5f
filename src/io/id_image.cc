#include "id_image.h"

#include <cstring>
#include <limits>
#include <string>
#include <string_view>

#include "npy_array.h"
#include "png_mask.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

template <typename Item>
IdMatrix FromItems(const NpyArray& array, const std::string& source) {
  IdMatrix ids(array.shape[0], array.shape[1]);
  for (Eigen::Index i = 0; i < ids.size(); ++i) {
    Item item;
    std::memcpy(&item, array.data() + static_cast<size_t>(i) * sizeof(Item), sizeof(Item));
    if (!std::in_range<int32_t>(item)) ThrowInputError("{}: id {} is out of range", source, item);
    // Ids of int8 are numbers, and may be negative. NOLINTNEXTLINE(bugprone-signed-char-misuse)
    ids.data()[i] = static_cast<int32_t>(item);
  }
  return ids;
}

IdImage FromNpy(const std::string& source) {
  const NpyArray array = ParseNpy(ReadFile(source), source);
  if (array.shape.size() != 2) {
    ThrowInputError("{}: {} dimensions where rows x columns are due", source, array.shape.size());
  }
  if (array.shape[0] == 0 || array.shape[1] == 0) {
    ThrowInputError("{}: {} rows and {} columns: no pixels", source, array.shape[0],
                    array.shape[1]);
  }
  const std::string& type = array.type;
  if (type == "u1") return {FromItems<uint8_t>(array, source), 255};
  if (type == "u2") return {FromItems<uint16_t>(array, source), 65535};
  if (type == "i1") return {FromItems<int8_t>(array, source), -1};
  if (type == "i2") return {FromItems<int16_t>(array, source), -1};
  if (type == "i4") return {FromItems<int32_t>(array, source), -1};
  if (type == "u4") return {FromItems<uint32_t>(array, source), -1};
  if (type == "i8") return {FromItems<int64_t>(array, source), -1};
  if (type == "u8") return {FromItems<uint64_t>(array, source), -1};
  ThrowInputError("{}: items of type {} where integers are due", source, type);
}

template <typename Item>
IdMatrix FromGray(const cv::Mat& image) {
  IdMatrix ids(image.rows, image.cols);
  for (int y = 0; y < image.rows; ++y) {
    const Item* row = image.ptr<Item>(y);
    for (int x = 0; x < image.cols; ++x) ids(y, x) = row[x];
  }
  return ids;
}

}  // namespace

SegmentImage IdsFromColours(const cv::Mat& bgr) {
  SegmentImage ids(bgr.rows, bgr.cols);
  const int channels = bgr.channels();
  for (int y = 0; y < bgr.rows; ++y) {
    const uint8_t* pixel = bgr.ptr<uint8_t>(y);
    for (int x = 0; x < bgr.cols; ++x, pixel += channels) {
      ids(y, x) = static_cast<uint32_t>(pixel[2] | pixel[1] << 8 | pixel[0] << 16);
    }
  }
  return ids;
}

IdImage ReadIdImage(const std::filesystem::path& path) {
  const std::string source = path.string();
  if (path.extension() == ".npy") return FromNpy(source);
  std::string bytes = ReadFile(path);
  CheckPngIsComplete(bytes, source);
  const auto [bits, colour_type] = KindOfPng(bytes);
  if (colour_type == kPngPalette) bytes = PaletteToGray(bytes);
  const cv::Mat image = DecodePngMask(bytes, source);
  if (bits > 0 && bits < 8) {
    if (colour_type != kPngPalette) {
      ThrowInputError(
          "{}: gray of {} bits, which is ids for some programs and shades for others: "
          "save 8 bits",
          source, bits);
    }
    // The decoder stretches small numbers to shades of gray.
    return {FromGray<uint8_t>(image) / (255 / ((1 << bits) - 1)), 255};
  }
  if (image.channels() == 1 && image.depth() == CV_8U) return {FromGray<uint8_t>(image), 255};
  if (image.channels() == 1 && image.depth() == CV_16U) return {FromGray<uint16_t>(image), 65535};
  if (image.channels() < 3 || image.depth() != CV_8U) {
    ThrowInputError("{}: {} channels of {} bits are no ids", source, image.channels(),
                    8 * image.elemSize1());
  }
  return {IdsFromColours(image).cast<int32_t>(), (1 << 24) - 1};
}

bool HasColourPixels(const std::filesystem::path& path) {
  const std::string bytes = ReadFile(path);
  return DecodePngMask(bytes, path.string()).channels() >= 3 &&
         KindOfPng(bytes).colour_type != kPngPalette;
}

}  // namespace s3lam
