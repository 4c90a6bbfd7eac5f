#include "mip_texture.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace s3lam::synthetic {

MipTexture::MipTexture(const cv::Mat& bgr) {
  cv::Mat image = bgr;
  while (true) {
    Level level;
    level.width = image.cols;
    level.height = image.rows;
    level.scale_x = static_cast<float>(image.cols) / static_cast<float>(bgr.cols);
    level.scale_y = static_cast<float>(image.rows) / static_cast<float>(bgr.rows);
    level.texels.reserve(image.total());
    for (int y = 0; y < image.rows; ++y) {
      const auto* row = image.ptr<cv::Vec3b>(y);
      for (int x = 0; x < image.cols; ++x) {
        level.texels.push_back(static_cast<uint32_t>(row[x][0] | row[x][1] << 8 | row[x][2] << 16));
      }
    }
    levels_.push_back(std::move(level));
    if (image.cols <= 2 || image.rows <= 2) return;
    cv::Mat half;
    cv::resize(image, half, cv::Size((image.cols + 1) / 2, (image.rows + 1) / 2), 0.0, 0.0,
               cv::INTER_AREA);
    image = half;
  }
}

MipTexture::Sampler MipTexture::At(float lod, float dither) const {
  const float top = static_cast<float>(levels_.size() - 1);
  // Rounding down happens above zero, so that it is the floor.
  const float level = std::clamp(std::max(lod, 0.0F) + dither, 0.0F, top);
  return Sampler(levels_[static_cast<size_t>(level)]);
}

}  // namespace s3lam::synthetic
