#include "scene_builder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/synthetic/synthetic_map.h"

namespace s3lam::synthetic {
namespace {

Plane PlaneOf(const std::vector<Eigen::Vector3d>& corners) {
  Plane plane;
  plane.normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
  plane.offset = -plane.normal.dot(corners[0]);
  return plane;
}

SemanticClass Class(int id, const char* name, bool thing, bool planar, int min_inliers,
                    SurfaceOrientation orientation = SurfaceOrientation::kAny) {
  SemanticClass c;
  c.id = id;
  c.name = name;
  c.is_thing = thing;
  c.is_planar = planar;
  if (planar) c.min_plane_inliers = min_inliers;
  c.orientation = orientation;
  // Well-spread colours from the id alone.
  const uint64_t bits = Rng(static_cast<uint64_t>(id) + 1).Bits();
  for (size_t k = 0; k < 3; ++k) c.color[k] = static_cast<uint8_t>(40 + ((bits >> (8 * k)) % 200));
  return c;
}

}  // namespace

ClassTable CocoClasses() {
  using enum SurfaceOrientation;
  return {"COCO panoptic (classes of the synthetic scenes)",
          {
              Class(coco::kSportsBall, "sports ball", true, false, 0),
              Class(coco::kBottle, "bottle", true, false, 0),
              Class(coco::kCup, "cup", true, false, 0),
              Class(coco::kBowl, "bowl", true, false, 0),
              Class(coco::kChair, "chair", true, false, 0),
              Class(coco::kCouch, "couch", true, false, 0),
              Class(coco::kPlant, "potted plant", true, false, 0),
              Class(coco::kDiningTable, "dining table", true, true, 50, kHorizontal),
              Class(coco::kTv, "tv", true, true, 40),
              Class(coco::kLaptop, "laptop", true, true, 40),
              Class(coco::kMouse, "mouse", true, false, 0),
              Class(coco::kKeyboard, "keyboard", true, true, 50),
              Class(coco::kBook, "book", true, true, 30),
              Class(coco::kVase, "vase", true, false, 0),
              Class(coco::kCardboard, "cardboard", false, true, 50),
              Class(coco::kDoor, "door-stuff", false, true, 50, kVertical),
              Class(coco::kFloorWood, "floor-wood", false, true, 50, kHorizontal),
              Class(coco::kShelf, "shelf", false, false, 0),
              Class(coco::kCeiling, "ceiling-merged", false, true, 50, kHorizontal),
              Class(coco::kCabinet, "cabinet-merged", false, true, 50),
              Class(coco::kFloorOther, "floor-other-merged", false, true, 50, kHorizontal),
              Class(coco::kPaper, "paper-merged", false, true, 30),
              Class(coco::kWallOther, "wall-other-merged", false, true, 50, kVertical),
              Class(coco::kRug, "rug-merged", false, true, 50, kHorizontal),
          }};
}

ClassTable CityscapesClasses() {
  using enum SurfaceOrientation;
  ClassTable table{"Cityscapes (classes of the synthetic scenes)",
                   {
                       Class(cityscapes::kRoad, "road", false, true, 50, kHorizontal),
                       Class(cityscapes::kSidewalk, "sidewalk", false, true, 50, kHorizontal),
                       Class(cityscapes::kBuilding, "building", false, true, 80, kVertical),
                       Class(cityscapes::kWall, "wall", false, true, 50, kVertical),
                       Class(cityscapes::kFence, "fence", false, true, 50, kVertical),
                       Class(cityscapes::kPole, "pole", false, false, 0),
                       Class(cityscapes::kSign, "traffic sign", false, true, 30),
                       Class(cityscapes::kVegetation, "vegetation", false, false, 0),
                       Class(cityscapes::kTerrain, "terrain", false, true, 80),
                       Class(cityscapes::kSky, "sky", false, false, 0),
                       Class(cityscapes::kCar, "car", true, false, 0),
                   }};
  table.classes.back().is_dynamic = true;
  return table;
}

Rigid3 Standing(double x, double y, double z, double yaw_rad) {
  return {QuaternionFromRotationVector({0.0, 0.0, yaw_rad}), {x, y, z}};
}

Rigid3 Hanging(const Eigen::Vector3d& center, double yaw_rad) {
  // The frame's z axis becomes the horizontal direction (sin yaw, -cos yaw, 0), its y axis up.
  const Eigen::Quaterniond stand = QuaternionFromRotationVector({0.5 * std::numbers::pi, 0.0, 0.0});
  return {(QuaternionFromRotationVector({0.0, 0.0, yaw_rad}) * stand).normalized(), center};
}

void FitObjectPlane(Scene& scene, int object, const Eigen::Vector3d& normal) {
  std::vector<Eigen::Vector3d> points;
  for (const Surface& surface : scene.surfaces) {
    if (surface.object != object || surface.shape != SurfaceShape::kPolygon) continue;
    if (std::abs(PlaneOf(surface.corners).normal.dot(normal)) < 0.94) continue;
    points.insert(points.end(), surface.corners.begin(), surface.corners.end());
  }
  const Plane plane = FitPlaneToPoints(points, points.front() + 1e3 * normal);
  SceneObject& target = scene.objects[static_cast<size_t>(object)];
  target.plane_in_world = plane;
  for (const Eigen::Vector3d& point : points) {
    target.flatness_m = std::max(target.flatness_m, std::abs(plane.SignedDistance(point)));
  }
}

int SceneBuilder::AddObject(const std::string& name, int class_id) {
  const std::optional<int> index = scene_.class_table.IndexOfId(class_id);
  S3LAM_CHECK(index.has_value());
  SceneObject object;
  object.id = static_cast<int>(scene_.objects.size()) + 1;
  object.name = name;
  object.class_id = class_id;
  object.is_thing = scene_.class_table.classes[static_cast<size_t>(*index)].is_thing;
  scene_.objects.push_back(std::move(object));
  return static_cast<int>(scene_.objects.size()) - 1;
}

Rgb SceneBuilder::Vary(const Rgb& color, int amount) {
  Rgb varied;
  for (size_t k = 0; k < 3; ++k) {
    const double value = color[k] + rng_.Uniform(-amount, amount);
    varied[k] = static_cast<uint8_t>(std::clamp(value, 10.0, 245.0));
  }
  return varied;
}

TextureSpec SceneBuilder::Texture(TextureStyle style, const Rgb& primary, const Rgb& secondary,
                                  double texel_m) {
  TextureSpec spec;
  spec.style = style;
  spec.seed = rng_.Bits();
  spec.primary = Vary(primary, 12);
  spec.secondary = Vary(secondary, 12);
  spec.texel_m = texel_m;
  return spec;
}

TextureSpec SceneBuilder::ColorfulTexture(TextureStyle style, double texel_m) {
  TextureSpec spec = Texture(style, {128, 128, 128}, {128, 128, 128}, texel_m);
  const bool dark_on_light = rng_.Below(2) == 0;
  for (size_t k = 0; k < 3; ++k) {
    const double light = rng_.Uniform(150.0, 235.0);
    const double dark = rng_.Uniform(20.0, 100.0);
    spec.primary[k] = static_cast<uint8_t>(dark_on_light ? light : dark);
    spec.secondary[k] = static_cast<uint8_t>(dark_on_light ? dark : light);
  }
  return spec;
}

Surface& SceneBuilder::AddPolygon(int object, std::vector<Eigen::Vector3d> corners,
                                  const TextureSpec& texture, bool main_face) {
  S3LAM_CHECK(corners.size() == 3 || corners.size() == 4);
  Surface surface;
  surface.object = object;
  surface.corners = std::move(corners);
  surface.texture = texture;
  surface.texture.seed = rng_.Bits();  // No two surfaces look alike.
  if (main_face) {
    scene_.objects[static_cast<size_t>(object)].plane_in_world = PlaneOf(surface.corners);
  }
  scene_.surfaces.push_back(std::move(surface));
  return scene_.surfaces.back();
}

Surface& SceneBuilder::AddParallelogram(int object, const Eigen::Vector3d& corner,
                                        const Eigen::Vector3d& u, const Eigen::Vector3d& v,
                                        const TextureSpec& texture, bool main_face) {
  return AddPolygon(object, {corner, corner + u, corner + u + v, corner + v}, texture, main_face);
}

void SceneBuilder::AddBox(int object, const Rigid3& world_from_base, const Eigen::Vector3d& size,
                          unsigned faces, unsigned main, const TextureSpec& main_texture,
                          const TextureSpec& other_texture) {
  const Eigen::Vector3d h(0.5 * size.x(), 0.5 * size.y(), size.z());
  // Each face: a corner and its two edges, in units of the half sizes (z: of the height).
  struct Face {
    unsigned bit;
    Eigen::Vector3d corner, u, v;
  };
  const std::array<Face, 6> all{{
      {kTop, {-1, -1, 1}, {2, 0, 0}, {0, 2, 0}},
      {kBottom, {-1, 1, 0}, {2, 0, 0}, {0, -2, 0}},
      {kFront, {-1, -1, 0}, {2, 0, 0}, {0, 0, 1}},
      {kBack, {1, 1, 0}, {-2, 0, 0}, {0, 0, 1}},
      {kLeft, {-1, 1, 0}, {0, -2, 0}, {0, 0, 1}},
      {kRight, {1, -1, 0}, {0, 2, 0}, {0, 0, 1}},
  }};
  for (const Face& face : all) {
    if ((faces & face.bit) == 0) continue;
    const bool is_main = (main & face.bit) != 0;
    AddParallelogram(object, world_from_base * h.cwiseProduct(face.corner),
                     world_from_base.rotation * h.cwiseProduct(face.u),
                     world_from_base.rotation * h.cwiseProduct(face.v),
                     is_main ? main_texture : other_texture, is_main);
  }
}

Surface& SceneBuilder::AddCylinder(int object, const Rigid3& world_from_base, double radius,
                                   double height, const TextureSpec& texture) {
  Surface surface;
  surface.shape = SurfaceShape::kCylinder;
  surface.object = object;
  surface.world_from_local = world_from_base;
  surface.radii = Eigen::Vector3d(radius, radius, height);
  surface.z_min = 0.0;
  surface.z_max = 1.0;
  surface.texture = texture;
  surface.texture.seed = rng_.Bits();
  scene_.surfaces.push_back(surface);
  return scene_.surfaces.back();
}

void SceneBuilder::AddLid(int object, const Rigid3& world_from_base, double radius, double height,
                          const TextureSpec& texture) {
  constexpr int kCorners = 10;
  const auto rim = [&](int k) {
    const double angle = 2.0 * std::numbers::pi * k / kCorners;
    return world_from_base *
           Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), height);
  };
  const Eigen::Vector3d center = world_from_base * Eigen::Vector3d(0.0, 0.0, height);
  for (int k = 0; k < kCorners; k += 2) {
    AddPolygon(object, {center, rim(k), rim(k + 1), rim(k + 2)}, texture);
  }
}

Surface& SceneBuilder::AddEllipsoid(int object, const Rigid3& world_from_center,
                                    const Eigen::Vector3d& radii, const TextureSpec& texture) {
  Surface surface;
  surface.shape = SurfaceShape::kEllipsoid;
  surface.object = object;
  surface.world_from_local = world_from_center;
  surface.radii = radii;
  surface.texture = texture;
  surface.texture.seed = rng_.Bits();
  scene_.surfaces.push_back(surface);
  return scene_.surfaces.back();
}

}  // namespace s3lam::synthetic
