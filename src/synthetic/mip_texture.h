#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

namespace s3lam::synthetic {

/// Three colour channels in the 16-bit lanes of one word (blue, red, green from the lowest), so
/// that they are blended together.
using Lanes = uint64_t;
inline constexpr Lanes kLaneMask = 0x000000FF00FF00FFULL;

inline Lanes LanesOfTexel(uint32_t bgr) {
  return (bgr & 0x00FF00FFU) | (static_cast<Lanes>(bgr & 0x0000FF00U) << 24);
}
inline Lanes LanesOfColor(uint32_t blue, uint32_t green, uint32_t red) {
  return LanesOfTexel(blue | green << 8 | red << 16);
}
inline uint32_t BlueOf(Lanes lanes) { return lanes & 0xFFFFU; }
inline uint32_t RedOf(Lanes lanes) { return (lanes >> 16) & 0xFFFFU; }
inline uint32_t GreenOf(Lanes lanes) { return (lanes >> 32) & 0xFFFFU; }

/// (a * (256 - weight) + b * weight) / 256 per lane, rounded; weight in [0, 256].
inline Lanes Blend(Lanes a, Lanes b, uint32_t weight) {
  constexpr Lanes kHalf = 0x0000008000800080ULL;
  return ((a * (256U - weight) + b * weight + kHalf) >> 8) & kLaneMask;
}
/// a * gain / 256 per lane; gain in [0, 256].
inline Lanes Scale(Lanes a, uint32_t gain) { return ((a * gain) >> 8) & kLaneMask; }

/// A texture with box-filtered pyramid levels.
class MipTexture {
 public:
  MipTexture() = default;
  explicit MipTexture(const cv::Mat& bgr);

  [[nodiscard]] int width() const { return levels_.front().width; }
  [[nodiscard]] int height() const { return levels_.front().height; }

  /// Of one level of detail, chosen once for neighbouring samples.
  class Sampler;
  /// `lod` = log2 of the footprint in texels of level 0: samples blend the two nearest levels.
  [[nodiscard]] Sampler At(float lod) const;

 private:
  struct Level {
    int width = 0;
    int height = 0;
    float scale_x = 1.0F;  // Of level 0 coordinates.
    float scale_y = 1.0F;
    std::vector<uint32_t> texels;
  };

  class LevelSampler;

  std::vector<Level> levels_;
};

/// Of one level of the pyramid.
class MipTexture::LevelSampler {
 public:
  explicit LevelSampler(const Level& level)
      : texels_(level.texels.data()),
        width_(level.width),
        scale_x_(level.scale_x),
        scale_y_(level.scale_y),
        last_x_(static_cast<float>(level.width - 1)),
        last_y_(static_cast<float>(level.height - 1)) {}

  /// Bilinear sample at (x, y) texels of level 0 (first texel's centre at 0.5), clamped at the
  /// border.
  [[nodiscard]] Lanes operator()(float x, float y) const {
    const float fx = std::min(std::max(x * scale_x_ - 0.5F, 0.0F), last_x_);
    const float fy = std::min(std::max(y * scale_y_ - 0.5F, 0.0F), last_y_);
    const int ix = static_cast<int>(fx);
    const int iy = static_cast<int>(fy);
    const float left = static_cast<float>(ix);
    const float top = static_cast<float>(iy);
    const auto wx = static_cast<uint32_t>(static_cast<int>((fx - left) * 256.0F));
    const auto wy = static_cast<uint32_t>(static_cast<int>((fy - top) * 256.0F));
    const int right = left < last_x_ ? 1 : 0;
    const int below = top < last_y_ ? width_ : 0;
    const uint32_t* at = texels_ + static_cast<ptrdiff_t>(iy) * width_ + ix;
    const Lanes upper = Blend(LanesOfTexel(at[0]), LanesOfTexel(at[right]), wx);
    const Lanes lower = Blend(LanesOfTexel(at[below]), LanesOfTexel(at[below + right]), wx);
    return Blend(upper, lower, wy);
  }

 private:
  const uint32_t* texels_;
  int width_;
  float scale_x_, scale_y_, last_x_, last_y_;
};

class MipTexture::Sampler {
 public:
  /// weight: of the coarse level, in [0, 256].
  Sampler(const Level& fine, const Level& coarse, uint32_t weight)
      : fine_(fine), coarse_(coarse), weight_(weight) {}

  /// At (x, y) texels of level 0 (first texel's centre at 0.5), clamped at the border.
  [[nodiscard]] Lanes operator()(float x, float y) const {
    const Lanes fine = fine_(x, y);
    return weight_ == 0 ? fine : Blend(fine, coarse_(x, y), weight_);
  }

 private:
  LevelSampler fine_, coarse_;
  uint32_t weight_;
};

}  // namespace s3lam::synthetic
