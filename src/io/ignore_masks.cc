#include "s3lam/io/ignore_masks.h"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <ostream>
#include <vector>

#include "png_mask.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {

std::filesystem::path IgnoreMaskPath(const std::filesystem::path& masks,
                                     const std::string& image_name) {
  return std::filesystem::is_regular_file(masks) ? masks : masks / (image_name + ".png");
}

cv::Mat MakeIgnoreMask(const PanopticFrame& frame, const ClassTable& class_table, int margin_px) {
  const SegmentImage& ids = frame.segment_ids;
  cv::Mat mask(static_cast<int>(ids.rows()), static_cast<int>(ids.cols()), CV_8UC1);
  uint32_t last_id = kNoSegment;
  uint8_t last_value = 255;
  for (int y = 0; y < mask.rows; ++y) {
    auto* row = mask.ptr<uint8_t>(y);
    for (int x = 0; x < mask.cols; ++x) {
      if (const uint32_t id = ids(y, x); id != last_id) {
        last_id = id;
        const auto it = frame.segments.find(id);
        const bool is_dynamic =
            it != frame.segments.end() &&
            class_table.classes[static_cast<size_t>(it->second.class_index)].is_dynamic;
        last_value = is_dynamic ? 0 : 255;
      }
      row[x] = last_value;
    }
  }
  if (margin_px > 0) {
    const cv::Size size(2 * margin_px + 1, 2 * margin_px + 1);
    cv::erode(mask, mask, cv::getStructuringElement(cv::MORPH_ELLIPSE, size));
  }
  return mask;
}

void WriteIgnoreMask(const cv::Mat& mask, const std::filesystem::path& directory,
                     const std::string& image_name) {
  const std::filesystem::path path = IgnoreMaskPath(directory, image_name);
  std::filesystem::create_directories(path.parent_path());
  std::vector<uint8_t> bytes;
  S3LAM_CHECK(cv::imencode(".png", mask, bytes));
  WriteFile(path, [&](std::ostream& stream) {
    stream.write(reinterpret_cast<const char*>(bytes.data()),
                 static_cast<std::streamsize>(bytes.size()));
  });
}

cv::Mat ReadIgnoreMask(const std::filesystem::path& masks, const std::string& image_name,
                       const cv::Size& size) {
  if (!HasIgnoreMask(masks, image_name)) return {};
  const std::filesystem::path path = IgnoreMaskPath(masks, image_name);
  cv::Mat mask = ReadPngMask(path);
  if (mask.type() != CV_8UC1) {
    ThrowInputError("{}: {} channel(s) of {} bits where a gray image of 8 bits is due",
                    path.string(), mask.channels(), 8 * mask.elemSize1());
  }
  if (mask.size() != size) {
    ThrowInputError("{}: the mask is {} x {} px but its image is {} x {} px", path.string(),
                    mask.cols, mask.rows, size.width, size.height);
  }
  return mask;
}

bool HasIgnoreMask(const std::filesystem::path& masks, const std::string& image_name) {
  return std::filesystem::is_regular_file(IgnoreMaskPath(masks, image_name));
}

}  // namespace s3lam
