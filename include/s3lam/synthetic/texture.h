#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "s3lam/scene/reconstruction.h"

namespace s3lam {

/// What a surface looks like.
enum class TextureStyle {
  kPlain,     // Nearly uniform, faint grain and a few scratches.
  kWood,      // Grain along u, knots, scratches.
  kCover,     // Book cover, poster or painting: blocks, lettering, shapes.
  kPage,      // Printed page: headline, lines of glyphs, figures.
  kKeyboard,  // Keys with legends.
  kScreen,    // Windows, text, icons.
  kFabric,    // Carpet or cloth: patches, woven grain.
  kPlaster,   // Wall paint: stains, grain, cracks.
  kBrick,     // Bricks of individual tones.
  kTiles,     // Tiles of individual tones and veins.
  kMottled,   // Strong multi-scale blobs: stone, ceramics glaze, foliage.
  kFacade,    // House front: windows, doors, ledges on brick or plaster.
  kAsphalt,   // Aggregate, patches, cracks, stains.
  kPavement,  // Slabs of individual tones.
  kMarking,   // Worn road paint.
  kCarBody,   // Paint, windows, handles, trim.
};

/// A procedural texture: a pure function of these fields.
struct TextureSpec {
  TextureStyle style = TextureStyle::kPlain;
  uint64_t seed = 0;
  Rgb primary{150, 150, 150};
  Rgb secondary{90, 90, 90};
  double texel_m = 0.002;  // Size of a texel on the surface.
};

/// Paints the texture of a rectangle of this size (m): BGR, row 0 at the upper edge (v = size.y).
/// At least 8 x 8 texels and at most 4096 along either side (texels then grow).
cv::Mat PaintTexture(const TextureSpec& spec, const Eigen::Vector2d& size_m);

}  // namespace s3lam
