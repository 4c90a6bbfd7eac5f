// A residential street with two turns: road, sidewalks, houses, parked cars, trees; a car's camera.

#include <algorithm>
#include <cmath>
#include <numbers>

#include "scene_builder.h"
#include "street_line.h"

namespace s3lam::synthetic {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRoadHalf = 4.2;
constexpr double kKerb = 0.13;
constexpr double kSidewalk = 2.2;
constexpr double kCameraHeight = 1.65;
constexpr double kSpeed = 6.0;  // m/s

class Street {
 public:
  Street(Scene& scene, uint64_t seed)
      : scene_(scene), build_(scene, Rng(seed).Fork(1).Bits()), line_(Rng(seed).Fork(4).Bits()) {}

  void Build() {
    AddGround();
    AddMarkings();
    for (const double side : {-1.0, 1.0}) {
      AddHouses(side);
      AddCars(side);
      AddTreesAndPoles(side);
    }
    SetPath();
  }

 private:
  // The point `side` metres to the left of the centre line at arc length s, `up` above the ground.
  [[nodiscard]] Eigen::Vector3d At(double s, double side, double up = 0.0) const {
    return line_.At(s, side, up);
  }
  [[nodiscard]] Rigid3 StandingAt(double s, double side, double up = 0.0) const {
    const Eigen::Vector3d p = At(s, side, up);
    return Standing(p.x(), p.y(), p.z(), line_.Heading(s));
  }

  void AddGround();
  void AddMarkings();
  void AddHouses(double side);
  void AddHouse(double side, double begin, double end, double offset);
  void AddGap(double side, double begin, double end, double offset);
  void AddCars(double side);
  void AddCar(const Rigid3& world_from_base);
  void AddTree(double s, double side);
  void AddTreesAndPoles(double side);
  void SetPath();

  Scene& scene_;
  SceneBuilder build_;
  StreetLine line_;
};

// Road and sidewalks are strips of flat pieces that follow the ground's gentle undulation; the
// object's plane is the best one through all of them.
void Street::AddGround() {
  constexpr double kPiece = 3.0;
  const int road = build_.AddObject("road", cityscapes::kRoad);
  const TextureSpec asphalt =
      build_.Texture(TextureStyle::kAsphalt, {128, 128, 130}, {78, 78, 82}, 0.012);
  const TextureSpec slabs =
      build_.Texture(TextureStyle::kPavement, {160, 156, 150}, {95, 92, 88}, 0.012);
  const TextureSpec grass =
      build_.Texture(TextureStyle::kMottled, {85, 105, 65}, {125, 120, 80}, 0.015);
  const int left = build_.AddObject("sidewalk_left", cityscapes::kSidewalk);
  const int right = build_.AddObject("sidewalk_right", cityscapes::kSidewalk);
  const int terrain = build_.AddObject("gardens", cityscapes::kTerrain);
  for (double s = line_.begin(); s < line_.end(); s += kPiece) {
    const double e = s + kPiece;
    const auto strip = [&](int object, double from, double to, double up, const TextureSpec& look) {
      build_.AddPolygon(object, {At(s, from, up), At(e, from, up), At(e, to, up), At(s, to, up)},
                        look);
    };
    strip(road, -kRoadHalf, kRoadHalf, 0.0, asphalt);
    const double outer = kRoadHalf + kSidewalk;
    strip(left, kRoadHalf, outer, kKerb, slabs);
    strip(right, -outer, -kRoadHalf, kKerb, slabs);
    strip(terrain, outer, outer + 2.6, kKerb - 0.01, grass);
    strip(terrain, -outer - 2.6, -outer, kKerb - 0.01, grass);
    for (const double side : {-1.0, 1.0}) {  // Kerbs.
      build_.AddPolygon(side > 0.0 ? left : right,
                        {At(s, side * kRoadHalf), At(e, side * kRoadHalf),
                         At(e, side * kRoadHalf, kKerb), At(s, side * kRoadHalf, kKerb)},
                        slabs);
    }
  }
  for (const int object : {road, left, right, terrain}) {
    FitObjectPlane(scene_, object, Eigen::Vector3d::UnitZ());
  }
}

void Street::AddMarkings() {
  constexpr double kAbove = 0.008;
  const TextureSpec paint =
      build_.Texture(TextureStyle::kMarking, {225, 225, 220}, {150, 150, 150}, 0.008);
  constexpr int kRoadObject = 0;
  for (double s = line_.begin() + 2.0; s < line_.end() - 4.0; s += build_.rng().Uniform(6.5, 8.5)) {
    const double length = build_.rng().Uniform(2.0, 3.0);
    build_.AddPolygon(kRoadObject,
                      {At(s, -0.06, kAbove), At(s + length, -0.06, kAbove),
                       At(s + length, 0.06, kAbove), At(s, 0.06, kAbove)},
                      paint);
  }
}

void Street::AddHouses(double side) {
  Rng& rng = build_.rng();
  double s = line_.begin() + rng.Uniform(0.0, 3.0);
  while (s < line_.end()) {
    // In a turn the front is bent into shorter pieces.
    const double length = line_.IsTurn(s) ? rng.Uniform(3.5, 5.0) : rng.Uniform(7.0, 12.0);
    const double offset = side * (kRoadHalf + kSidewalk + rng.Uniform(0.3, 2.2));
    AddHouse(side, s, s + length, offset);
    s += length;
    if (rng.Below(3) == 0) {
      const double gap = rng.Uniform(2.0, 4.0);
      AddGap(side, s, s + gap, offset);
      s += gap;
    }
  }
  // Both ends of the street are closed by a house across it.
  for (const double end : {line_.begin() - 1.0, line_.end() + 12.0}) {
    const int house = build_.AddObject("house_across", cityscapes::kBuilding);
    const Eigen::Vector3d corner = At(end, side * 14.0);
    build_.AddParallelogram(
        house, corner, At(end, 0.0) - corner, {0.0, 0.0, 7.5},
        build_.Texture(TextureStyle::kFacade, {185, 170, 150}, {110, 90, 80}, 0.015), true);
  }
}

void Street::AddHouse(double side, double begin, double end, double offset) {
  Rng& rng = build_.rng();
  constexpr double kDepth = 4.5;
  const int house = build_.AddObject("house", cityscapes::kBuilding);
  TextureSpec look = build_.ColorfulTexture(TextureStyle::kFacade, 0.012);
  for (size_t k = 0; k < 3; ++k) {  // Muted colours.
    look.primary[k] = static_cast<uint8_t>(140 + look.primary[k] / 3);
    look.secondary[k] = static_cast<uint8_t>(75 + look.secondary[k] / 4);
  }
  const double height = rng.Uniform(5.5, 9.0);
  const Eigen::Vector3d up(0.0, 0.0, height);
  Eigen::Vector3d a = At(begin, offset, -0.3);
  Eigen::Vector3d b = At(end, offset, -0.3);
  b.z() = a.z();                    // Houses stand upright on bent ground.
  if (side < 0.0) std::swap(a, b);  // The front faces the road.
  Eigen::Vector3d back = (b - a).cross(Eigen::Vector3d::UnitZ()).normalized();
  if (back.dot(At(0.5 * (begin + end), 0.0) - a) > 0.0) back = -back;
  build_.AddParallelogram(house, a, b - a, up, look, true);
  TextureSpec flank = look;
  flank.style = TextureStyle::kBrick;
  flank.texel_m = 0.02;
  build_.AddParallelogram(house, a + kDepth * back, -kDepth * back, up, flank);
  build_.AddParallelogram(house, b, kDepth * back, up, flank);
  constexpr double kRidge = 2.6;  // Above the eaves.
  for (const Eigen::Vector3d& eaves : {Eigen::Vector3d(a + up), Eigen::Vector3d(b + up)}) {
    const Eigen::Vector3d far = eaves + 3.7 * back;
    build_.AddPolygon(house, {eaves, far, far + Eigen::Vector3d(0.0, 0.0, kRidge)}, flank);
  }
  const TextureSpec tiles = build_.Texture(TextureStyle::kBrick, {150, 85, 65}, {95, 55, 45}, 0.03);
  build_.AddParallelogram(house, a + up - 0.3 * back, b - a,
                          4.0 * back + Eigen::Vector3d(0.0, 0.0, kRidge), tiles);
}

void Street::AddGap(double side, double begin, double end, double offset) {
  const bool is_wall = build_.rng().Below(2) == 0;
  const int wall = build_.AddObject(is_wall ? "wall" : "fence",
                                    is_wall ? cityscapes::kWall : cityscapes::kFence);
  const Eigen::Vector3d a = At(begin, offset, -0.3);
  Eigen::Vector3d b = At(end, offset, -0.3);
  b.z() = a.z();
  build_.AddParallelogram(wall, side > 0.0 ? a : b, side > 0.0 ? b - a : a - b,
                          {0.0, 0.0, build_.rng().Uniform(1.5, 2.2)},
                          build_.Texture(is_wall ? TextureStyle::kBrick : TextureStyle::kWood,
                                         {160, 130, 105}, {95, 75, 60}, 0.01),
                          true);
  AddTree(0.5 * (begin + end), offset + side * 1.8);
}

void Street::AddTree(double s, double side) {
  Rng& rng = build_.rng();
  const int tree = build_.AddObject("tree", cityscapes::kVegetation);
  const Rigid3 base = StandingAt(s, side);
  const double height = rng.Uniform(2.2, 3.2);
  build_.AddCylinder(tree, base, rng.Uniform(0.1, 0.18), height,
                     build_.Texture(TextureStyle::kMottled, {95, 75, 60}, {55, 45, 35}, 0.008));
  const TextureSpec leaves =
      build_.Texture(TextureStyle::kMottled, {55, 85, 45}, {130, 155, 90}, 0.02);
  for (int i = 0; i < 5; ++i) {
    const double angle = 2.0 * kPi * i / 5.0 + rng.Uniform(0.0, 0.8);
    const double out = rng.Uniform(0.3, 0.9);
    build_.AddEllipsoid(tree,
                        base * Standing(out * std::cos(angle), out * std::sin(angle),
                                        height + rng.Uniform(0.0, 1.4), angle),
                        {rng.Uniform(0.6, 1.1), rng.Uniform(0.6, 1.1), rng.Uniform(0.6, 1.1)},
                        leaves);
  }
}

void Street::AddTreesAndPoles(double side) {
  Rng& rng = build_.rng();
  for (double s = line_.begin() + rng.Uniform(4.0, 12.0); s < line_.end();
       s += rng.Uniform(11.0, 19.0)) {
    const double offset = side * (kRoadHalf + rng.Uniform(0.5, 0.9));
    if (rng.Below(2) == 0) {
      AddTree(s, offset);
      continue;
    }
    const int pole = build_.AddObject("pole", cityscapes::kPole);
    build_.AddCylinder(
        pole, StandingAt(s, offset), 0.07, rng.Uniform(3.0, 6.0),
        build_.Texture(TextureStyle::kMottled, {120, 120, 118}, {85, 85, 85}, 0.006));
    const int sign = build_.AddObject("sign", cityscapes::kSign);
    const Rigid3 board = StandingAt(s, offset, 2.3);
    // Faces the car that comes along the street, i.e. backwards.
    build_.AddParallelogram(sign, board * Eigen::Vector3d(-0.09, 0.35, 0.0),
                            board.rotation * Eigen::Vector3d(0.0, -0.7, 0.0),
                            board.rotation * Eigen::Vector3d(0.0, 0.0, 0.7),
                            build_.ColorfulTexture(TextureStyle::kCover, 0.006), true);
  }
}

void Street::AddCars(double side) {
  Rng& rng = build_.rng();
  for (double s = line_.begin() + rng.Uniform(2.0, 8.0); s < line_.end() - 3.0;
       s += rng.Uniform(5.6, 11.0)) {
    if (line_.IsTurn(s) || line_.IsTurn(s + 4.0) || rng.Below(4) == 0) continue;
    const Rigid3 spot = StandingAt(s, side * rng.Uniform(3.15, 3.3)) *
                        Standing(0.0, 0.0, 0.0, side > 0.0 ? kPi : 0.0);
    AddCar(spot * Standing(0.0, 0.0, 0.0, rng.Uniform(-0.03, 0.03)));
  }
}

// About 4.2 x 1.7 x 1.45 m along x, on rounded ends, with a tapering cabin.
void Street::AddCar(const Rigid3& world_from_base) {
  Rng& rng = build_.rng();
  const int car = build_.AddObject("car", cityscapes::kCar);
  const TextureSpec paint = build_.ColorfulTexture(TextureStyle::kCarBody, 0.006);
  const TextureSpec window =
      build_.Texture(TextureStyle::kPlain, {62, 70, 76}, {35, 40, 45}, 0.008);
  const TextureSpec tyre =
      build_.Texture(TextureStyle::kMottled, {40, 40, 42}, {75, 75, 78}, 0.006);
  const double length = rng.Uniform(3.7, 4.3);
  const double height = rng.Uniform(0.62, 0.75);
  build_.AddBox(car, world_from_base * Standing(0.0, 0.0, 0.22, 0.0), {length, 1.66, height},
                kAllButBottom, 0, paint, paint);
  for (const double end : {-1.0, 1.0}) {
    build_.AddEllipsoid(car, world_from_base * Standing(end * 0.5 * length, 0.0, 0.5, 0.0),
                        {0.2, 0.8, 0.27}, paint);
  }
  // The cabin: a frustum from the waist line to the roof.
  const double low = 0.22 + height;
  const double high = low + rng.Uniform(0.5, 0.62);
  const auto ring = [&](double x0, double x1, double y, double z) {
    return std::vector<Eigen::Vector3d>{
        world_from_base * Eigen::Vector3d(x0, -y, z), world_from_base * Eigen::Vector3d(x1, -y, z),
        world_from_base * Eigen::Vector3d(x1, y, z), world_from_base * Eigen::Vector3d(x0, y, z)};
  };
  const auto waist = ring(-0.48 * length, 0.26 * length, 0.78, low);
  const auto roof = ring(-0.36 * length, 0.08 * length, 0.62, high);
  for (size_t k = 0; k < 4; ++k) {
    const size_t n = (k + 1) % 4;
    build_.AddPolygon(car, {waist[k], waist[n], roof[n], roof[k]}, window);
  }
  build_.AddPolygon(car, roof, paint);
  for (const double x : {-0.32 * length, 0.32 * length}) {
    for (const double y : {-0.85, 0.65}) {
      Rigid3 axle = world_from_base * Standing(x, y + 0.2, 0.31, 0.0);
      axle.rotation =
          (axle.rotation * QuaternionFromRotationVector({0.5 * kPi, 0.0, 0.0})).normalized();
      build_.AddCylinder(car, axle, 0.31, 0.2, tyre);
      build_.AddLid(car, axle, 0.31, y > 0.0 ? 0.0 : 0.2, tyre);
    }
  }
}

void Street::SetPath() {
  constexpr double kKnotSpacing = 3.0;
  constexpr double kLookAhead = 2.5;
  Rng rng = Rng(scene_.seed).Fork(2);
  const double weave = rng.Uniform(0.0, 2.0 * kPi);
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3d> targets;
  for (double s = 0.0; s <= line_.drive_length(); s += kKnotSpacing) {
    const double side = -0.35 + 0.15 * std::sin(s / 17.0 + weave);
    positions.push_back(At(s, side, kCameraHeight));
    targets.push_back(At(s + kLookAhead, side, kCameraHeight - 0.02));
  }
  scene_.path = CameraPath(positions, targets, line_.drive_length() / kSpeed, {0.0025, 0.006, 1.3},
                           rng.Bits());
}

}  // namespace

void BuildStreet(Scene& scene) {
  scene.class_table = CityscapesClasses();
  scene.layout = SequenceLayout::kKittiStep;
  scene.fps = 10.0;
  scene.background = {215, 222, 232};
  scene.background_class_id = cityscapes::kSky;
  scene.imaging.color = false;
  scene.imaging.exposure_time_s = 0.004;
  Rng rng = Rng(scene.seed).Fork(3);
  scene.camera = Camera();
  scene.camera.id = CameraId(1);
  scene.camera.model = CameraModel::kPinhole;  // Rectified, as KITTI's images are.
  scene.camera.width = 1226;
  scene.camera.height = 370;
  const double focal = rng.Uniform(700.0, 720.0);
  scene.camera.params = {focal, focal, 613.0 + rng.Uniform(-8.0, 8.0),
                         185.0 + rng.Uniform(-4.0, 4.0)};
  Street(scene, scene.seed).Build();
}

}  // namespace s3lam::synthetic
