#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "s3lam/base/rng.h"
#include "s3lam/geometry/rigid3.h"
#include "s3lam/synthetic/scene.h"

namespace s3lam::synthetic {

/// Faces of a box, to be combined.
enum BoxFaces : unsigned {
  kTop = 1,
  kBottom = 2,
  kFront = 4,  // Towards -y.
  kBack = 8,   // Towards +y.
  kLeft = 16,  // Towards -x.
  kRight = 32,
  kAllFaces = 63,
  kAllButBottom = 61,
};

/// COCO panoptic ids.
namespace coco {
inline constexpr int kSportsBall = 37, kBottle = 44, kCup = 47, kBowl = 51, kChair = 62,
                     kCouch = 63, kPlant = 64, kDiningTable = 67, kTv = 72, kLaptop = 73,
                     kMouse = 74, kKeyboard = 76, kBook = 84, kVase = 86, kCardboard = 100,
                     kDoor = 112, kFloorWood = 118, kShelf = 156, kCeiling = 186, kCabinet = 188,
                     kFloorOther = 190, kPaper = 195, kWallOther = 199, kRug = 200;
}  // namespace coco

/// Cityscapes trainIds.
namespace cityscapes {
inline constexpr int kRoad = 0, kSidewalk = 1, kBuilding = 2, kWall = 3, kFence = 4, kPole = 5,
                     kSign = 7, kVegetation = 8, kTerrain = 9, kSky = 10, kCar = 13;
}  // namespace cityscapes

/// The classes that the scenes use, out of COCO panoptic and Cityscapes.
ClassTable CocoClasses();
ClassTable CityscapesClasses();

/// Puts objects and their surfaces into a scene.
class SceneBuilder {
 public:
  SceneBuilder(Scene& scene, uint64_t seed) : scene_(scene), rng_(seed) {}

  Rng& rng() { return rng_; }

  /// A new object of a class of the scene's table; returns its index.
  int AddObject(const std::string& name, int class_id);

  /// A texture of its own seed; the colours are varied a little.
  TextureSpec Texture(TextureStyle style, const Rgb& primary, const Rgb& secondary, double texel_m);
  /// The same with random, clearly different colours.
  TextureSpec ColorfulTexture(TextureStyle style, double texel_m);

  /// The parallelogram corner, corner + u, corner + u + v, corner + v, its front towards u x v.
  /// `main_face` makes its plane the object's.
  Surface& AddParallelogram(int object, const Eigen::Vector3d& corner, const Eigen::Vector3d& u,
                            const Eigen::Vector3d& v, const TextureSpec& texture,
                            bool main_face = false);
  /// Convex polygon with three or four corners.
  Surface& AddPolygon(int object, std::vector<Eigen::Vector3d> corners, const TextureSpec& texture,
                      bool main_face = false);

  /// A box standing on world_from_base's z = 0, centred in x and y. `main` is the face whose plane
  /// becomes the object's (0: none); that face gets `main_texture`.
  void AddBox(int object, const Rigid3& world_from_base, const Eigen::Vector3d& size,
              unsigned faces, unsigned main, const TextureSpec& main_texture,
              const TextureSpec& other_texture);

  /// A cylinder's mantle standing on world_from_base's z = 0. The references that these return hold
  /// until the next surface is added.
  Surface& AddCylinder(int object, const Rigid3& world_from_base, double radius, double height,
                       const TextureSpec& texture);
  /// Four- or more-cornered disc is not needed: a lid is a square's inscribed octagon in two
  /// halves.
  void AddLid(int object, const Rigid3& world_from_base, double radius, double height,
              const TextureSpec& texture);
  Surface& AddEllipsoid(int object, const Rigid3& world_from_center, const Eigen::Vector3d& radii,
                        const TextureSpec& texture);

  // Furniture and clutter shared by the scenes; all stand on world_from_base's z = 0.
  void AddBook(const Rigid3& world_from_base, const Eigen::Vector3d& size);
  /// An open magazine whose pages bulge: of a planar class, and not a plane.
  void AddBulgingMagazine(const Rigid3& world_from_base, double width, double depth);
  void AddSheet(const Rigid3& world_from_base, double width, double depth, int class_id,
                TextureStyle style);
  void AddCup(const Rigid3& world_from_base, double radius, double height);
  void AddBowl(const Rigid3& world_from_base, double radius);
  void AddBottle(const Rigid3& world_from_base, double radius, double height);
  void AddBall(const Rigid3& world_from_base, double radius);
  void AddPlant(const Rigid3& world_from_base, double radius, double height);
  void AddCarton(const Rigid3& world_from_base, const Eigen::Vector3d& size);
  void AddMonitor(const Rigid3& world_from_base, double width, double tilt_rad);
  void AddLaptop(const Rigid3& world_from_base);
  void AddKeyboard(const Rigid3& world_from_base);
  void AddTable(const Rigid3& world_from_base, const Eigen::Vector3d& size, double texel_m);
  void AddChair(const Rigid3& world_from_base);

 private:
  Rgb Vary(const Rgb& color, int amount);

  Scene& scene_;
  Rng rng_;
};

/// World from a frame standing at (x, y, z), turned by `yaw_rad` about the vertical.
Rigid3 Standing(double x, double y, double z, double yaw_rad);

/// Four walls' worth of picture: a rectangle on a vertical plane. Its centre, the direction of its
/// lower edge and its normal follow from `yaw_rad`: the outward normal is (sin yaw, -cos yaw, 0).
Rigid3 Hanging(const Eigen::Vector3d& center, double yaw_rad);

/// Gives an object of several pieces the best plane through all of its polygons' corners that lie
/// face up (normal along `normal` within 20 degrees), and their largest distance as its flatness.
void FitObjectPlane(Scene& scene, int object, const Eigen::Vector3d& normal);

// The scenes.
void BuildDesk(Scene& scene);
void BuildFloor(Scene& scene);
void BuildPosters(Scene& scene);
void BuildRoom(Scene& scene);
void BuildStreet(Scene& scene);

}  // namespace s3lam::synthetic
