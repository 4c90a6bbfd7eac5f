// A floor seen from above, with a rug and things lying about; the camera wanders over it.

#include <cmath>
#include <numbers>

#include "scene_builder.h"

namespace s3lam::synthetic {
namespace {

constexpr double kHalf = 5.0;

void AddClutter(SceneBuilder& build) {
  Rng& rng = build.rng();
  // One thing per cell of a coarse grid, so that nothing overlaps; some cells stay empty.
  constexpr double kCell = 0.75;
  int number = 0;
  for (double y = -1.6; y < 3.2; y += kCell) {
    for (double x = -2.6; x < 2.7; x += kCell) {
      const Rigid3 spot = Standing(x + rng.Uniform(-0.15, 0.15), y + rng.Uniform(-0.15, 0.15), 0.01,
                                   rng.Uniform(-3.0, 3.0));
      switch (rng.Below(12)) {
        case 0:
        case 1:
          build.AddBook(
              spot, {rng.Uniform(0.17, 0.24), rng.Uniform(0.24, 0.32), rng.Uniform(0.015, 0.05)});
          break;
        case 2:
          build.AddSheet(spot, 0.3, 0.42, coco::kPaper, TextureStyle::kPage);
          break;
        case 3:
          build.AddBulgingMagazine(spot, 0.42, 0.29);
          break;
        case 4:
          build.AddBall(spot, rng.Uniform(0.06, 0.11));
          break;
        case 5:
          build.AddBowl(spot, rng.Uniform(0.09, 0.14));
          break;
        case 6:
          if (++number <= 4) {
            build.AddCarton(
                spot, {rng.Uniform(0.25, 0.4), rng.Uniform(0.2, 0.35), rng.Uniform(0.12, 0.3)});
          }
          break;
        case 7:
          build.AddCup(spot, 0.045, 0.11);
          break;
        default:
          break;
      }
    }
  }
}

}  // namespace

void BuildFloor(Scene& scene) {
  scene.class_table = CocoClasses();
  SceneBuilder build(scene, Rng(scene.seed).Fork(1).Bits());
  const int floor = build.AddObject("floor", coco::kFloorWood);
  build.AddParallelogram(
      floor, {-kHalf, -kHalf, 0.0}, {2.0 * kHalf, 0.0, 0.0}, {0.0, 2.0 * kHalf, 0.0},
      build.Texture(TextureStyle::kWood, {165, 125, 85}, {90, 60, 35}, 0.0025), true);
  const int rug = build.AddObject("rug", coco::kRug);
  const Rigid3 rug_pose = Standing(build.rng().Uniform(-0.6, 0.6), build.rng().Uniform(0.6, 1.2),
                                   0.008, build.rng().Uniform(-0.5, 0.5));
  build.AddParallelogram(rug, rug_pose * Eigen::Vector3d(-1.1, -0.75, 0.0),
                         rug_pose.rotation * Eigen::Vector3d(2.2, 0.0, 0.0),
                         rug_pose.rotation * Eigen::Vector3d(0.0, 1.5, 0.0),
                         build.ColorfulTexture(TextureStyle::kFabric, 0.002), true);
  AddClutter(build);

  Rng rng = Rng(scene.seed).Fork(2);
  constexpr int kKnots = 16;
  const double phase = rng.Uniform(0.0, 2.0 * std::numbers::pi);
  const double sense = rng.Below(2) == 0 ? 1.0 : -1.0;
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3d> targets;
  for (int i = 0; i < kKnots; ++i) {
    const double angle = phase + sense * 2.0 * std::numbers::pi * 0.9 * i / (kKnots - 1);
    const Eigen::Vector3d position(1.15 * std::cos(angle) + rng.Uniform(-0.06, 0.06),
                                   -0.5 + 0.75 * std::sin(angle) + rng.Uniform(-0.06, 0.06),
                                   1.3 + 0.12 * std::sin(2.0 * angle) + rng.Uniform(-0.03, 0.03));
    const double gaze = 0.35 * std::sin(angle + 0.8);
    positions.push_back(position);
    targets.emplace_back(position.x() + 1.15 * std::sin(gaze), position.y() + 1.15 * std::cos(gaze),
                         0.0);
  }
  scene.path = CameraPath(positions, targets, 9.0, {0.007, 0.005, 0.8}, rng.Bits());
}

}  // namespace s3lam::synthetic
