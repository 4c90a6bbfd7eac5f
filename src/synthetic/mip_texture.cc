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

MipTexture::Sampler MipTexture::At(float lod) const {
  const float top = static_cast<float>(levels_.size() - 1);
  const float level = std::clamp(lod, 0.0F, top);
  const auto fine = static_cast<size_t>(level);
  const size_t coarse = std::min(fine + 1, levels_.size() - 1);
  const float share = level - static_cast<float>(fine);
  return {levels_[fine], levels_[coarse], static_cast<uint32_t>(share * 256.0F + 0.5F)};
}

}  // namespace s3lam::synthetic
