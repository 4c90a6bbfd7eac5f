// A furnished room with walls at right angles; the camera turns once round and a little further,
// so that it sees its start again.

#include <array>
#include <cmath>
#include <numbers>

#include "scene_builder.h"

namespace s3lam::synthetic {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kHalfX = 2.9;
constexpr double kHalfY = 2.4;
constexpr double kHeight = 2.6;

// One wall: its name, the yaw of its inner normal (see Hanging), its centre on the floor, its
// width.
struct WallPlace {
  const char* name;
  double yaw;
  Eigen::Vector2d foot;
  double width;
};
const std::array<WallPlace, 4> kWalls{{{"wall_north", 0.0, {0.0, kHalfY}, 2.0 * kHalfX},
                                       {"wall_east", -0.5 * kPi, {kHalfX, 0.0}, 2.0 * kHalfY},
                                       {"wall_south", kPi, {0.0, -kHalfY}, 2.0 * kHalfX},
                                       {"wall_west", 0.5 * kPi, {-kHalfX, 0.0}, 2.0 * kHalfY}}};

Rigid3 OnWall(const WallPlace& wall, double along, double height, double off = 0.0) {
  return Hanging({wall.foot.x(), wall.foot.y(), height}, wall.yaw) *
         Rigid3{Eigen::Quaterniond::Identity(), {along, 0.0, off}};
}

void AddOnWall(SceneBuilder& build, int object, const Rigid3& center, double width, double height,
               const TextureSpec& texture, bool main_face = true) {
  build.AddParallelogram(object, center * Eigen::Vector3d(-0.5 * width, -0.5 * height, 0.0),
                         center.rotation * Eigen::Vector3d(width, 0.0, 0.0),
                         center.rotation * Eigen::Vector3d(0.0, height, 0.0), texture, main_face);
}

void AddShell(SceneBuilder& build) {
  const int floor = build.AddObject("floor", coco::kFloorWood);
  build.AddParallelogram(
      floor, {-kHalfX, -kHalfY, 0.0}, {2.0 * kHalfX, 0.0, 0.0}, {0.0, 2.0 * kHalfY, 0.0},
      build.Texture(TextureStyle::kWood, {155, 115, 75}, {85, 55, 35}, 0.003), true);
  const int ceiling = build.AddObject("ceiling", coco::kCeiling);
  build.AddParallelogram(
      ceiling, {-kHalfX, kHalfY, kHeight}, {2.0 * kHalfX, 0.0, 0.0}, {0.0, -2.0 * kHalfY, 0.0},
      build.Texture(TextureStyle::kTiles, {215, 213, 208}, {165, 160, 155}, 0.004), true);
  const std::array<TextureStyle, 4> styles{TextureStyle::kPlaster, TextureStyle::kBrick,
                                           TextureStyle::kPlaster, TextureStyle::kTiles};
  for (size_t i = 0; i < kWalls.size(); ++i) {
    const int wall = build.AddObject(kWalls[i].name, coco::kWallOther);
    AddOnWall(build, wall, OnWall(kWalls[i], 0.0, 0.5 * kHeight), kWalls[i].width, kHeight,
              build.Texture(styles[i], {200, 190, 170}, {135, 110, 95}, 0.003));
  }
}

void AddPictures(SceneBuilder& build) {
  Rng& rng = build.rng();
  for (const WallPlace& wall : kWalls) {
    for (double along = -0.5 * wall.width + 0.5; along < 0.5 * wall.width - 0.4;
         along += rng.Uniform(0.95, 1.25)) {
      const int picture = build.AddObject("picture", coco::kPaper);
      AddOnWall(build, picture, OnWall(wall, along, rng.Uniform(1.3, 1.75), 0.012),
                rng.Uniform(0.45, 0.8), rng.Uniform(0.4, 0.75),
                build.ColorfulTexture(TextureStyle::kCover, 0.0025));
    }
  }
}

void AddFurniture(SceneBuilder& build) {
  Rng& rng = build.rng();
  // A cabinet with books and clutter on it along the north wall.
  const int cabinet = build.AddObject("cabinet", coco::kCabinet);
  const TextureSpec wood = build.Texture(TextureStyle::kWood, {140, 95, 60}, {75, 45, 25}, 0.002);
  const double cabinet_x = rng.Uniform(-0.5, 0.2);
  build.AddBox(cabinet, Standing(cabinet_x, kHalfY - 0.24, 0.0, 0.0), {1.8, 0.45, 0.9},
               kAllButBottom, kFront, wood, wood);
  for (int i = 0; i < 5; ++i) {
    const Rigid3 spot =
        Standing(cabinet_x - 0.7 + 0.34 * i, kHalfY - 0.24 + rng.Uniform(-0.06, 0.06), 0.9,
                 rng.Uniform(-0.5, 0.5));
    if (i == 1)
      build.AddBottle(spot, 0.045, 0.3);
    else if (i == 3)
      build.AddPlant(spot, 0.15, 0.4);
    else
      build.AddBook(spot, {0.2, 0.27, rng.Uniform(0.03, 0.12)});
  }
  // A door in the east wall.
  const int door = build.AddObject("door", coco::kDoor);
  AddOnWall(build, door, OnWall(kWalls[1], rng.Uniform(0.9, 1.3), 1.0, 0.02), 0.9, 2.0,
            build.Texture(TextureStyle::kWood, {175, 150, 115}, {90, 65, 40}, 0.0025));
  // A table with things in the south-east, chairs round it.
  const double table_x = 1.75;
  const double table_y = -1.4;
  build.AddTable(Standing(table_x, table_y, 0.0, rng.Uniform(-0.1, 0.1)), {1.3, 0.8, 0.74}, 0.002);
  build.AddLaptop(Standing(table_x - 0.2, table_y, 0.74, rng.Uniform(2.0, 3.0)));
  build.AddBulgingMagazine(Standing(table_x + 0.3, table_y + 0.15, 0.74, 0.5), 0.4, 0.28);
  build.AddCup(Standing(table_x + 0.05, table_y + 0.25, 0.74, 0.0), 0.045, 0.1);
  build.AddBook(Standing(table_x - 0.4, table_y + 0.2, 0.74, 0.3), {0.18, 0.25, 0.03});
  build.AddChair(Standing(0.85, -1.5, 0.0, 1.5));
  build.AddChair(Standing(1.9, -0.6, 0.0, 0.2));
  // A couch (domed cushions) at the west wall, cartons, a plant, a ball.
  const int couch = build.AddObject("couch", coco::kCouch);
  for (int i = 0; i < 2; ++i) {
    const double y = -0.55 + 0.8 * i;
    const TextureSpec fabric = build.ColorfulTexture(TextureStyle::kFabric, 0.0025);
    build.AddEllipsoid(couch, Standing(-kHalfX + 0.5, y, 0.3, 0.0), {0.45, 0.42, 0.2}, fabric);
    build.AddEllipsoid(couch, Standing(-kHalfX + 0.18, y, 0.6, 0.0), {0.16, 0.42, 0.35}, fabric);
  }
  build.AddCarton(Standing(-2.3, 1.7, 0.0, 0.3), {0.6, 0.45, 0.5});
  build.AddCarton(Standing(-2.35, 1.75, 0.5, 0.7), {0.4, 0.35, 0.35});
  build.AddCarton(Standing(-1.2, -2.0, 0.0, -0.2), {0.5, 0.4, 0.45});
  build.AddPlant(Standing(2.4, 1.9, 0.0, 0.0), 0.3, 1.1);
  build.AddBall(Standing(0.1, -1.9, 0.0, 0.0), 0.14);
  build.AddMonitor(Standing(2.45, 0.2, 0.6, -0.5 * kPi), 0.8, 0.08);
  const int stand = build.AddObject("stand", coco::kCabinet);
  build.AddBox(stand, Standing(2.5, 0.2, 0.0, -0.5 * kPi), {1.0, 0.5, 0.6}, kAllButBottom, kFront,
               wood, wood);
}

}  // namespace

void BuildRoom(Scene& scene) {
  scene.class_table = CocoClasses();
  SceneBuilder build(scene, Rng(scene.seed).Fork(1).Bits());
  AddShell(build);
  AddPictures(build);
  AddFurniture(build);

  Rng rng = Rng(scene.seed).Fork(2);
  constexpr double kDuration = 14.0;
  constexpr double kTurns = 1.12;
  constexpr int kKnots = 26;
  const double start = rng.Uniform(-kPi, kPi);
  const double sense = rng.Below(2) == 0 ? 1.0 : -1.0;
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3d> targets;
  for (int i = 0; i < kKnots; ++i) {
    const double angle = start + sense * 2.0 * kPi * kTurns * i / (kKnots - 1);
    const double x = std::cos(angle);
    const double y = std::sin(angle);
    positions.emplace_back(1.15 * x, 0.9 * y, 1.45 + rng.Uniform(-0.06, 0.06));
    // Ahead of the radius, so that what comes into view has parallax.
    const double gaze = angle + sense * 0.35;
    targets.emplace_back(2.6 * std::cos(gaze), 2.2 * std::sin(gaze), 0.95 + rng.Uniform(-0.1, 0.1));
  }
  scene.path = CameraPath(positions, targets, kDuration, {0.008, 0.006, 0.8}, rng.Bits());
}

}  // namespace s3lam::synthetic
