#include "id_image.h"

#include <cstring>
#include <limits>
#include <map>
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

/// The decoder looks palettes up; this undoes it.
void ColoursToIndices(std::string_view palette, const std::string& source, IdMatrix& colours) {
  std::map<int32_t, int32_t> index_of;
  for (size_t i = 0; i + 2 < palette.size(); i += 3) {
    const auto byte = [&](size_t k) { return static_cast<uint8_t>(palette[i + k]); };
    const int32_t colour = byte(0) | byte(1) << 8 | byte(2) << 16;
    const auto [it, is_new] = index_of.emplace(colour, static_cast<int32_t>(i / 3));
    if (!is_new) it->second = -1;
  }
  for (int32_t& value : colours.reshaped<Eigen::RowMajor>()) {
    const auto it = index_of.find(value);
    if (it == index_of.end() || it->second < 0) {
      ThrowInputError("{}: the palette has one colour for several indices; save as gray", source);
    }
    value = it->second;
  }
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
  const std::string bytes = ReadFile(path);
  const cv::Mat image = DecodePngMask(bytes, source);
  if (image.channels() == 1 && image.depth() == CV_8U) return {FromGray<uint8_t>(image), 255};
  if (image.channels() == 1 && image.depth() == CV_16U) return {FromGray<uint16_t>(image), 65535};
  if (image.channels() < 3 || image.depth() != CV_8U) {
    ThrowInputError("{}: {} channels of {} bits are no ids", source, image.channels(),
                    8 * image.elemSize1());
  }
  IdImage result{IdsFromColours(image).cast<int32_t>(), (1 << 24) - 1};
  if (const std::string_view palette = PngPalette(bytes); !palette.empty()) {
    ColoursToIndices(palette, source, result.ids);
    result.minus_one = 255;
  }
  return result;
}

bool HasColourPixels(const std::filesystem::path& path) {
  const std::string bytes = ReadFile(path);
  return DecodePngMask(bytes, path.string()).channels() >= 3 && PngPalette(bytes).empty();
}

}  // namespace s3lam
