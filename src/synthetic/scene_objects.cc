// Furniture and clutter.

#include <cmath>
#include <numbers>

#include "scene_builder.h"

namespace s3lam::synthetic {
namespace {

constexpr double kPi = std::numbers::pi;

Rigid3 Moved(const Rigid3& base, double x, double y, double z, double yaw_rad = 0.0) {
  return base * Standing(x, y, z, yaw_rad);
}

}  // namespace

void SceneBuilder::AddBook(const Rigid3& world_from_base, const Eigen::Vector3d& size) {
  const int object = AddObject("book", coco::kBook);
  AddBox(object, world_from_base, size, kAllButBottom, kTop,
         ColorfulTexture(TextureStyle::kCover, 0.001),
         Texture(TextureStyle::kWood, {215, 210, 195}, {150, 140, 120}, 0.001));
}

void SceneBuilder::AddBulgingMagazine(const Rigid3& world_from_base, double width, double depth) {
  const int object = AddObject("open_magazine", coco::kBook);
  // Each page is a strip of a lying cylinder: chord `width` / 2 and a rise of a tenth of it.
  const double chord = 0.5 * width;
  const double rise = 0.12 * chord;
  const double radius = (0.25 * chord * chord + rise * rise) / (2.0 * rise);
  const double half_angle = std::asin(0.5 * chord / radius);
  for (const double side : {-1.0, 1.0}) {
    // The cylinder's axis lies along y, below the table by (radius - rise).
    Rigid3 axis = Moved(world_from_base, 0.5 * side * chord, 0.5 * depth, rise - radius);
    axis.rotation =
        (axis.rotation * QuaternionFromRotationVector({0.5 * kPi, 0.0, 0.0})).normalized();
    Surface& page = AddCylinder(object, axis, radius, depth,
                                Texture(TextureStyle::kPage, {235, 233, 225}, {40, 40, 45}, 0.001));
    page.angle_min = 0.5 * kPi - half_angle;
    page.angle_max = 0.5 * kPi + half_angle;
  }
}

void SceneBuilder::AddSheet(const Rigid3& world_from_base, double width, double depth, int class_id,
                            TextureStyle style) {
  const int object = AddObject("sheet", class_id);
  const TextureSpec texture = style == TextureStyle::kPage
                                  ? Texture(style, {238, 236, 230}, {45, 45, 50}, 0.001)
                                  : ColorfulTexture(style, 0.0015);
  AddParallelogram(object, world_from_base * Eigen::Vector3d(-0.5 * width, -0.5 * depth, 0.0),
                   world_from_base.rotation * Eigen::Vector3d(width, 0.0, 0.0),
                   world_from_base.rotation * Eigen::Vector3d(0.0, depth, 0.0), texture, true);
}

void SceneBuilder::AddCup(const Rigid3& world_from_base, double radius, double height) {
  const int object = AddObject("cup", coco::kCup);
  const TextureSpec glaze = ColorfulTexture(TextureStyle::kCover, 0.0008);
  AddCylinder(object, world_from_base, radius, height, glaze);
  AddLid(object, world_from_base, radius, 0.8 * height,
         Texture(TextureStyle::kMottled, {70, 45, 30}, {40, 25, 15}, 0.001));
}

void SceneBuilder::AddBowl(const Rigid3& world_from_base, double radius) {
  const int object = AddObject("bowl", coco::kBowl);
  Surface& bowl =
      AddEllipsoid(object, Moved(world_from_base, 0.0, 0.0, 0.7 * radius),
                   {radius, radius, 0.7 * radius}, ColorfulTexture(TextureStyle::kMottled, 0.001));
  bowl.z_max = 0.0;
}

void SceneBuilder::AddBottle(const Rigid3& world_from_base, double radius, double height) {
  const int object = AddObject("bottle", coco::kBottle);
  AddCylinder(object, world_from_base, radius, 0.7 * height,
              ColorfulTexture(TextureStyle::kCover, 0.0008));
  const TextureSpec glass = Texture(TextureStyle::kMottled, {60, 90, 60}, {120, 160, 120}, 0.001);
  Surface& shoulder = AddEllipsoid(object, Moved(world_from_base, 0.0, 0.0, 0.7 * height),
                                   {radius, radius, 0.12 * height}, glass);
  shoulder.z_min = 0.0;
  AddCylinder(object, Moved(world_from_base, 0.0, 0.0, 0.78 * height), 0.35 * radius, 0.22 * height,
              glass);
}

void SceneBuilder::AddBall(const Rigid3& world_from_base, double radius) {
  const int object = AddObject("ball", coco::kSportsBall);
  AddEllipsoid(object, Moved(world_from_base, 0.0, 0.0, radius), {radius, radius, radius},
               ColorfulTexture(TextureStyle::kMottled, 0.0015));
}

void SceneBuilder::AddPlant(const Rigid3& world_from_base, double radius, double height) {
  const int object = AddObject("plant", coco::kPlant);
  AddCylinder(object, world_from_base, 0.6 * radius, 0.35 * height,
              ColorfulTexture(TextureStyle::kMottled, 0.0015));
  const int num_clumps = 5 + static_cast<int>(rng_.Below(3));
  for (int i = 0; i < num_clumps; ++i) {
    const double angle = 2.0 * kPi * i / num_clumps + rng_.Uniform(0.0, 0.5);
    const double out = radius * rng_.Uniform(0.2, 0.6);
    const double up = height * rng_.Uniform(0.5, 0.85);
    const Eigen::Vector3d radii =
        radius *
        Eigen::Vector3d(rng_.Uniform(0.3, 0.6), rng_.Uniform(0.3, 0.6), rng_.Uniform(0.4, 0.8));
    AddEllipsoid(object,
                 Moved(world_from_base, out * std::cos(angle), out * std::sin(angle), up, angle),
                 radii, Texture(TextureStyle::kMottled, {50, 100, 45}, {120, 170, 80}, 0.0015));
  }
}

void SceneBuilder::AddCarton(const Rigid3& world_from_base, const Eigen::Vector3d& size) {
  const int object = AddObject("carton", coco::kCardboard);
  const TextureSpec printed = Texture(TextureStyle::kCover, {185, 150, 105}, {70, 50, 35}, 0.0015);
  AddBox(object, world_from_base, size, kAllButBottom, kTop, printed, printed);
}

void SceneBuilder::AddMonitor(const Rigid3& world_from_base, double width, double tilt_rad) {
  const int object = AddObject("monitor", coco::kTv);
  const double height = 0.6 * width;
  const TextureSpec plastic = Texture(TextureStyle::kPlain, {45, 45, 48}, {90, 90, 95}, 0.002);
  AddBox(object, world_from_base, {0.4 * width, 0.25 * width, 0.015}, kAllButBottom, 0, plastic,
         plastic);
  AddBox(object, Moved(world_from_base, 0.0, 0.03, 0.0), {0.06, 0.03, 0.2}, kAllButBottom, 0,
         plastic, plastic);
  Rigid3 panel = Moved(world_from_base, 0.0, 0.0, 0.1);
  panel.rotation =
      (panel.rotation * QuaternionFromRotationVector({-tilt_rad, 0.0, 0.0})).normalized();
  AddBox(object, panel, {width, 0.03, height}, kAllFaces, kFront,
         Texture(TextureStyle::kScreen, {40, 60, 95}, {215, 220, 225}, 0.001), plastic);
}

void SceneBuilder::AddLaptop(const Rigid3& world_from_base) {
  const int object = AddObject("laptop", coco::kLaptop);
  const TextureSpec shell = Texture(TextureStyle::kPlain, {150, 150, 155}, {90, 90, 95}, 0.002);
  AddBox(object, world_from_base, {0.34, 0.24, 0.018}, kAllButBottom, kTop,
         Texture(TextureStyle::kKeyboard, {60, 60, 64}, {215, 215, 215}, 0.001), shell);
  Rigid3 lid = Moved(world_from_base, 0.0, 0.12, 0.018);
  lid.rotation = (lid.rotation * QuaternionFromRotationVector({-0.3, 0.0, 0.0})).normalized();
  AddBox(object, lid, {0.34, 0.008, 0.22}, kAllFaces, kFront,
         Texture(TextureStyle::kScreen, {50, 70, 60}, {225, 225, 215}, 0.001), shell);
}

void SceneBuilder::AddKeyboard(const Rigid3& world_from_base) {
  const int object = AddObject("keyboard", coco::kKeyboard);
  AddBox(object, world_from_base, {0.45, 0.16, 0.02}, kAllButBottom, kTop,
         Texture(TextureStyle::kKeyboard, {50, 50, 54}, {215, 215, 210}, 0.001),
         Texture(TextureStyle::kPlain, {40, 40, 42}, {80, 80, 80}, 0.002));
}

void SceneBuilder::AddTable(const Rigid3& world_from_base, const Eigen::Vector3d& size,
                            double texel_m) {
  constexpr double kThickness = 0.04;
  constexpr double kLeg = 0.06;
  const int object = AddObject("table", coco::kDiningTable);
  const TextureSpec wood = Texture(TextureStyle::kWood, {170, 125, 80}, {95, 60, 35}, texel_m);
  AddBox(object, Moved(world_from_base, 0.0, 0.0, size.z() - kThickness),
         {size.x(), size.y(), kThickness}, kAllFaces, kTop, wood, wood);
  for (const double x : {-1.0, 1.0}) {
    for (const double y : {-1.0, 1.0}) {
      AddBox(object,
             Moved(world_from_base, x * (0.5 * size.x() - kLeg), y * (0.5 * size.y() - kLeg), 0.0),
             {kLeg, kLeg, size.z() - kThickness}, kFront | kBack | kLeft | kRight, 0, wood, wood);
    }
  }
}

void SceneBuilder::AddChair(const Rigid3& world_from_base) {
  const int object = AddObject("chair", coco::kChair);
  const TextureSpec fabric = ColorfulTexture(TextureStyle::kFabric, 0.002);
  const TextureSpec metal = Texture(TextureStyle::kPlain, {120, 120, 120}, {60, 60, 60}, 0.003);
  // A domed seat and a bent back: chairs are not planes.
  AddEllipsoid(object, Moved(world_from_base, 0.0, 0.0, 0.44), {0.23, 0.23, 0.05}, fabric);
  Rigid3 back = Moved(world_from_base, 0.0, -0.15, 0.5);
  Surface& bent = AddCylinder(object, back, 0.4, 0.42, fabric);
  bent.angle_min = 0.5 * kPi - 0.55;
  bent.angle_max = 0.5 * kPi + 0.55;
  for (const double x : {-0.17, 0.17}) {
    for (const double y : {-0.17, 0.17}) {
      AddCylinder(object, Moved(world_from_base, x, y, 0.0), 0.012, 0.43, metal);
    }
  }
}

}  // namespace s3lam::synthetic
