#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

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
  kAsphalt,   // Aggregate, patches, cracks; in world coordinates, so that pieces join.
  kPavement,  // Slabs of individual tones; in world coordinates.
  kGrass,     // In world coordinates.
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

}  // namespace s3lam
