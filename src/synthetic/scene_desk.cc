// A table with the things of an office on it, in the corner of a room; the camera sways round it.

#include <cmath>
#include <numbers>

#include "scene_builder.h"

namespace s3lam::synthetic {
namespace {

constexpr double kTableHeight = 0.74;
constexpr double kBackWallY = 1.1;

void AddSurroundings(SceneBuilder& build) {
  const int floor = build.AddObject("floor", coco::kFloorWood);
  build.AddParallelogram(floor, {-4.5, -3.5, 0.0}, {9.0, 0.0, 0.0}, {0.0, 7.0, 0.0},
                         build.Texture(TextureStyle::kWood, {150, 115, 80}, {80, 55, 35}, 0.003),
                         true);
  const int wall = build.AddObject("wall_back", coco::kWallOther);
  build.AddParallelogram(
      wall, {-4.5, kBackWallY, 0.0}, {9.0, 0.0, 0.0}, {0.0, 0.0, 2.8},
      build.Texture(TextureStyle::kPlaster, {205, 200, 185}, {150, 140, 125}, 0.003), true);
  for (const double x : {-1.25, 0.1, 1.2}) {
    const int picture = build.AddObject("picture", coco::kPaper);
    const double width = build.rng().Uniform(0.5, 0.8);
    const double height = build.rng().Uniform(0.5, 0.7);
    const double low = build.rng().Uniform(1.15, 1.35);
    build.AddParallelogram(picture, {x - 0.5 * width, kBackWallY - 0.01, low}, {width, 0.0, 0.0},
                           {0.0, 0.0, height}, build.ColorfulTexture(TextureStyle::kCover, 0.0015),
                           true);
  }
}

void AddThingsOnTable(SceneBuilder& build) {
  Rng& rng = build.rng();
  const auto on_table = [&](double x, double y, double yaw) {
    return Standing(x + rng.Uniform(-0.03, 0.03), y + rng.Uniform(-0.02, 0.02), kTableHeight,
                    yaw + rng.Uniform(-0.2, 0.2));
  };
  build.AddMonitor(on_table(-0.1, 0.25, 0.0), 0.55, rng.Uniform(0.05, 0.2));
  build.AddKeyboard(on_table(-0.1, -0.12, 0.0));
  const int mouse = build.AddObject("mouse", coco::kMouse);
  build.AddEllipsoid(mouse, on_table(0.2, -0.1, 0.3), {0.03, 0.05, 0.03},
                     build.ColorfulTexture(TextureStyle::kMottled, 0.001));
  // Two stacks of books and one lying alone.
  for (const double x : {0.5, -0.62}) {
    Rigid3 base = on_table(x, -0.13, 0.3);
    for (int i = 0; i < 3; ++i) {
      const double thickness = rng.Uniform(0.015, 0.04);
      build.AddBook(base, {rng.Uniform(0.16, 0.22), rng.Uniform(0.22, 0.28), thickness});
      base = base * Standing(rng.Uniform(-0.015, 0.015), rng.Uniform(-0.015, 0.015), thickness,
                             rng.Uniform(-0.4, 0.4));
    }
  }
  build.AddBook(on_table(0.22, 0.17, -0.5), {0.19, 0.25, 0.025});
  build.AddBulgingMagazine(on_table(-0.36, -0.24, 0.2), 0.36, 0.24);
  build.AddSheet(on_table(0.27, -0.28, -0.3) * Standing(0.0, 0.0, 0.001, 0.0), 0.21, 0.297,
                 coco::kPaper, TextureStyle::kPage);
  build.AddCup(on_table(0.35, 0.02, 0.0), 0.04, 0.1);
  build.AddCup(on_table(-0.47, 0.1, 0.0), 0.038, 0.09);
  build.AddBowl(on_table(0.62, 0.24, 0.0), 0.09);
  build.AddBottle(on_table(0.47, 0.3, 0.0), 0.035, 0.26);
  build.AddPlant(on_table(-0.68, 0.28, 0.0), 0.13, 0.36);
  build.AddCarton(on_table(-0.47, 0.3, 0.4), {0.2, 0.14, 0.16});
}

}  // namespace

void BuildDesk(Scene& scene) {
  scene.class_table = CocoClasses();
  SceneBuilder build(scene, Rng(scene.seed).Fork(1).Bits());
  AddSurroundings(build);
  build.AddTable(Standing(0.0, 0.0, 0.0, build.rng().Uniform(-0.04, 0.04)),
                 {1.7, 0.8, kTableHeight}, 0.0015);
  AddThingsOnTable(build);
  build.AddCarton(Standing(1.3, 0.6, 0.0, 0.2), {0.45, 0.35, 0.4});
  build.AddCarton(Standing(-1.35, 0.5, 0.0, -0.3), {0.5, 0.35, 0.55});
  build.AddBall(Standing(1.25, -0.1, 0.0, 0.0), 0.12);

  // From left to right and half way back, nearer then farther, at eye height of one who sits or
  // stands.
  Rng rng = Rng(scene.seed).Fork(2);
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3d> targets;
  const double swing = rng.Below(2) == 0 ? 1.0 : -1.0;
  constexpr int kKnots = 12;
  for (int i = 0; i < kKnots; ++i) {
    const double phase = static_cast<double>(i) / (kKnots - 1);
    const double azimuth = swing * 0.75 * std::cos(1.5 * std::numbers::pi * phase);
    const double radius =
        1.25 + 0.2 * std::sin(2.2 * std::numbers::pi * phase) + rng.Uniform(-0.06, 0.06);
    positions.emplace_back(
        radius * std::sin(azimuth), -radius * std::cos(azimuth),
        kTableHeight + 0.55 + 0.15 * std::sin(5.0 * phase) + rng.Uniform(-0.05, 0.05));
    targets.emplace_back(0.15 * std::sin(azimuth) + rng.Uniform(-0.05, 0.05),
                         0.05 + rng.Uniform(-0.04, 0.04), kTableHeight + 0.08);
  }
  scene.path = CameraPath(positions, targets, 8.0, {0.006, 0.004, 0.8}, rng.Bits());
}

}  // namespace s3lam::synthetic
