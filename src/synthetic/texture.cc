#include "s3lam/synthetic/texture.h"

#include <algorithm>
#include <cmath>

#include "painter.h"

namespace s3lam {
namespace {

constexpr int kMinTexels = 8;
constexpr int kMaxTexels = 4096;

void Paint(TextureStyle style, synthetic::Painter& p) {
  switch (style) {
    case TextureStyle::kPlain:
      p.AddNoiseOctaves(48.0, 5.0);
      p.AddFlecks(80.0, 0.003, 0.02, 40.0);
      return;
    case TextureStyle::kWood:
      return synthetic::PaintWood(p);
    case TextureStyle::kCover:
      return synthetic::PaintCover(p);
    case TextureStyle::kPage:
      return synthetic::PaintPage(p);
    case TextureStyle::kKeyboard:
      return synthetic::PaintKeyboard(p);
    case TextureStyle::kScreen:
      return synthetic::PaintScreen(p);
    case TextureStyle::kFabric:
      return synthetic::PaintFabric(p);
    case TextureStyle::kPlaster:
      return synthetic::PaintPlaster(p);
    case TextureStyle::kBrick:
      return synthetic::PaintBrick(p);
    case TextureStyle::kTiles:
      return synthetic::PaintTiles(p);
    case TextureStyle::kMottled:
      p.AddMottling(std::max(12.0, std::min(p.width(), p.height()) / 6.0));
      return p.AddNoiseOctaves(8.0, 6.0);
    case TextureStyle::kFacade:
      return synthetic::PaintFacade(p);
    case TextureStyle::kAsphalt:
      return synthetic::PaintAsphalt(p);
    case TextureStyle::kPavement:
      return synthetic::PaintPavement(p);
    case TextureStyle::kMarking:
      p.AddNoiseOctaves(32.0, 9.0);
      return p.AddFlecks(60.0, 0.02, 0.15, 90.0);
    case TextureStyle::kCarBody:
      return synthetic::PaintCarBody(p);
  }
}

}  // namespace

cv::Mat PaintTexture(const TextureSpec& spec, const Eigen::Vector2d& size_m) {
  const double longest = size_m.maxCoeff() / spec.texel_m;
  const double texels_per_m = std::min(1.0, kMaxTexels / longest) / spec.texel_m;
  const auto texels = [&](double length_m) {
    return std::clamp(static_cast<int>(std::ceil(length_m * texels_per_m)), kMinTexels, kMaxTexels);
  };
  synthetic::Painter painter(spec, cv::Size(texels(size_m.x()), texels(size_m.y())), texels_per_m);
  Paint(spec.style, painter);
  return painter.image();
}

}  // namespace s3lam
