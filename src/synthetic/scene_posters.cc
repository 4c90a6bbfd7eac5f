// Sheets on one wall, coplanar, with a shelf of rounder things below; the camera passes along it.

#include <cmath>
#include <numbers>

#include "scene_builder.h"

namespace s3lam::synthetic {
namespace {

constexpr double kHalfWidth = 4.5;
constexpr double kSheetGap = 0.004;  // Between wall and sheets: all sheets share one plane.

void AddSheets(SceneBuilder& build) {
  Rng& rng = build.rng();
  int number = 0;
  for (const double z : {0.95, 1.55, 2.15}) {
    for (double x = -2.9; x < 3.0; x += 0.72, ++number) {
      const double width = rng.Uniform(0.42, 0.62);
      const double height = rng.Uniform(0.38, 0.52);
      const Rigid3 center =
          Hanging({x + rng.Uniform(-0.04, 0.04), -kSheetGap, z + rng.Uniform(-0.03, 0.03)}, 0.0) *
          Standing(0.0, 0.0, 0.0, rng.Uniform(-0.1, 0.1));
      const bool is_paper = number % 5 == 3;
      const int sheet = build.AddObject("sheet", is_paper ? coco::kPaper : coco::kBook);
      build.AddParallelogram(
          sheet, center * Eigen::Vector3d(-0.5 * width, -0.5 * height, 0.0),
          center.rotation * Eigen::Vector3d(width, 0.0, 0.0),
          center.rotation * Eigen::Vector3d(0.0, height, 0.0),
          is_paper ? build.Texture(TextureStyle::kPage, {236, 234, 226}, {40, 40, 45}, 0.0015)
                   : build.ColorfulTexture(TextureStyle::kCover, 0.0015),
          true);
    }
  }
}

void AddShelf(SceneBuilder& build) {
  Rng& rng = build.rng();
  constexpr double kDepth = 0.22;
  constexpr double kTopZ = 0.6;
  const int shelf = build.AddObject("shelf", coco::kShelf);
  const TextureSpec wood = build.Texture(TextureStyle::kWood, {150, 110, 70}, {80, 50, 30}, 0.002);
  build.AddBox(shelf, Standing(0.0, -0.5 * kDepth, kTopZ - 0.03, 0.0),
               {2.0 * kHalfWidth, kDepth, 0.03}, kAllFaces, 0, wood, wood);
  for (double x = -2.8; x < 2.9; x += rng.Uniform(0.35, 0.6)) {
    const Rigid3 spot =
        Standing(x, -0.5 * kDepth + rng.Uniform(-0.02, 0.02), kTopZ, rng.Uniform(-0.6, 0.6));
    switch (rng.Below(5)) {
      case 0:
        build.AddCup(spot, 0.042, 0.1);
        break;
      case 1:
        build.AddBottle(spot, 0.035, 0.24);
        break;
      case 2:
        build.AddBall(spot, rng.Uniform(0.05, 0.09));
        break;
      case 3:
        build.AddBowl(spot, 0.09);
        break;
      default:
        build.AddPlant(spot, 0.1, 0.26);
    }
  }
}

}  // namespace

void BuildPosters(Scene& scene) {
  scene.class_table = CocoClasses();
  SceneBuilder build(scene, Rng(scene.seed).Fork(1).Bits());
  const int wall = build.AddObject("wall", coco::kWallOther);
  build.AddParallelogram(
      wall, {-kHalfWidth, 0.0, 0.0}, {2.0 * kHalfWidth, 0.0, 0.0}, {0.0, 0.0, 3.2},
      build.Texture(TextureStyle::kPlaster, {200, 198, 190}, {140, 132, 120}, 0.0025), true);
  const int floor = build.AddObject("floor", coco::kFloorOther);
  build.AddParallelogram(
      floor, {-kHalfWidth, -3.0, 0.0}, {2.0 * kHalfWidth, 0.0, 0.0}, {0.0, 3.0, 0.0},
      build.Texture(TextureStyle::kTiles, {150, 145, 140}, {90, 85, 80}, 0.004), true);
  AddSheets(build);
  AddShelf(build);

  // To and fro along the wall, near it, the gaze slanted by up to 25 degrees.
  Rng rng = Rng(scene.seed).Fork(2);
  constexpr int kKnots = 16;
  const double sense = rng.Below(2) == 0 ? 1.0 : -1.0;
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3d> targets;
  for (int i = 0; i < kKnots; ++i) {
    const double angle = 1.5 * std::numbers::pi * i / (kKnots - 1);
    const double x = -sense * 1.6 * std::cos(angle);
    const double distance = 1.15 + 0.2 * std::sin(1.7 * angle) + rng.Uniform(-0.05, 0.05);
    const double z = 1.4 + 0.22 * std::sin(1.3 * angle + 0.5) + rng.Uniform(-0.04, 0.04);
    positions.emplace_back(x, -distance, z);
    targets.emplace_back(x + 0.45 * std::sin(2.1 * angle), 0.0, z - 0.05 + rng.Uniform(-0.1, 0.1));
  }
  scene.path = CameraPath(positions, targets, 9.0, {0.007, 0.005, 0.8}, rng.Bits());
}

}  // namespace s3lam::synthetic
