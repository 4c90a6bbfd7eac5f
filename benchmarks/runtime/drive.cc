#include "runtime/drive.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "s3lam/base/rng.h"

namespace s3lam::benchmarks {
namespace {

constexpr double kCameraHeight = 1.6;   // m
constexpr double kHalfStreet = 8.0;     // m, from the path to the facades
constexpr double kFacadeLength = 20.0;  // m
constexpr double kGroundLength = 40.0;  // m
constexpr double kMinDepth = 4.0;       // m
constexpr double kMaxDepth = 40.0;      // m
constexpr double kPixelSigma = 0.5;

/// The ring the street follows; z up.
class Ring {
 public:
  explicit Ring(int num_keyframes)
      : length_(std::max(200, num_keyframes / 2)), radius_(length_ / (2.0 * std::numbers::pi)) {}

  [[nodiscard]] int length() const { return length_; }  // m, and keyframes of a lap
  [[nodiscard]] Eigen::Vector3d At(double s, double outward, double up) const {
    const double angle = s / radius_;
    const double r = radius_ + outward;
    return {r * std::cos(angle), r * std::sin(angle), up};
  }
  /// A camera at s, looking along the street.
  [[nodiscard]] Rigid3 CamFromWorld(double s) const {
    const double angle = s / radius_;
    Eigen::Matrix3d rotation;
    rotation.row(0) << std::cos(angle), std::sin(angle), 0.0;  // Right is outward.
    rotation.row(1) << 0.0, 0.0, -1.0;
    rotation.row(2) << -std::sin(angle), std::cos(angle), 0.0;
    const Eigen::Quaterniond q(rotation);
    return {q, -(q * At(s, 0.0, kCameraHeight))};
  }

 private:
  int length_;
  double radius_;
};

struct Place {
  Eigen::Vector3d point;
  int plane;  // -1: none
};

class DriveMaker {
 public:
  DriveMaker(int num_keyframes, int points_per_keyframe, uint64_t seed)
      : num_keyframes_(num_keyframes),
        points_per_keyframe_(points_per_keyframe),
        ring_(num_keyframes),
        rng_(seed) {}

  Drive Make() {
    Camera camera;
    camera.id = CameraId(1);
    camera.width = 1200;
    camera.height = 700;
    camera.params = {700.0, 700.0, 600.0, 350.0};
    drive_.model.cameras[camera.id] = camera;
    for (int i = 0; i < num_keyframes_; ++i) {
      Image image;
      image.id = ImageId(static_cast<uint32_t>(i + 1));
      image.camera_id = camera.id;
      image.name = std::to_string(i + 1) + ".png";
      image.cam_from_world = ring_.CamFromWorld(i);
      drive_.model.images[image.id] = image;
      poses_.push_back(image.cam_from_world);
    }
    MakePlanes();
    // Along the drive, as points of a map are found.
    const double count = static_cast<double>(num_keyframes_) * points_per_keyframe_;
    const double span = std::min(num_keyframes_, ring_.length());
    for (double k = 0; k < count; ++k) AddPoint(camera, span * k / count);
    return std::move(drive_);
  }

 private:
  void MakePlanes() {
    const auto pieces = [&](double length) {
      return static_cast<int>(std::ceil((ring_.length() + kMaxDepth) / length));
    };
    for (const double side : {-kHalfStreet, kHalfStreet}) {
      for (int k = 0; k < pieces(kFacadeLength); ++k) {
        const Eigen::Vector3d begin = ring_.At(k * kFacadeLength, side, 0.0);
        const Eigen::Vector3d end = ring_.At((k + 1) * kFacadeLength, side, 0.0);
        const Eigen::Vector3d normal = Eigen::Vector3d::UnitZ().cross(end - begin).normalized();
        AddPlane(normal, 0.5 * (begin + end) + 2.0 * Eigen::Vector3d::UnitZ());
      }
    }
    first_ground_ = static_cast<int>(drive_.planes.size());
    for (int k = 0; k < pieces(kGroundLength); ++k) {
      AddPlane(Eigen::Vector3d::UnitZ(), ring_.At((k + 0.5) * kGroundLength, 0.0, 0.0));
    }
  }

  void AddPlane(const Eigen::Vector3d& normal, const Eigen::Vector3d& anchor) {
    drive_.planes.push_back(AnchoredPlane::FromPlane({normal, -normal.dot(anchor)}, anchor));
  }

  Place MakePlace(double s) {
    const double kind = rng_.Uniform();
    if (kind < 0.3) {
      return {ring_.At(s, rng_.Uniform(-5.0, 5.0), 0.0),
              first_ground_ + static_cast<int>(s / kGroundLength)};
    }
    if (kind < 0.6) {
      const bool outer = rng_.Uniform() < 0.5;
      const double side = outer ? kHalfStreet : -kHalfStreet;
      const int piece = static_cast<int>(s / kFacadeLength);
      const Eigen::Vector3d begin = ring_.At(piece * kFacadeLength, side, 0.0);
      const Eigen::Vector3d end = ring_.At((piece + 1) * kFacadeLength, side, 0.0);
      const double part = s / kFacadeLength - piece;
      const Eigen::Vector3d up(0.0, 0.0, rng_.Uniform(0.0, 5.0));
      return {begin + part * (end - begin) + up, outer ? first_ground_ / 2 + piece : piece};
    }
    return {ring_.At(s, rng_.Uniform(-7.5, 7.5), rng_.Uniform(0.0, 5.0)), -1};
  }

  /// A point ahead of s, seen by some keyframes in a row, and now and then on the second lap too.
  void AddPoint(const Camera& camera, double s) {
    const Place place = MakePlace(s + rng_.Uniform(kMinDepth, kMaxDepth));
    ScenePoint point;
    point.xyz = place.point;
    const PointId id(drive_.model.points.size() + 1);
    AddRun(camera, static_cast<int>(s), id, point);
    if (rng_.Uniform() < 0.35) AddRun(camera, static_cast<int>(s) + ring_.length(), id, point);
    if (point.track.size() < 2) {
      for (const TrackElement& element : point.track) {
        drive_.model.images.at(element.image_id).points2D.pop_back();
      }
      return;
    }
    if (place.plane >= 0) drive_.plane_of_point[id] = place.plane;
    drive_.model.points[id] = std::move(point);
  }

  void AddRun(const Camera& camera, int keyframe, PointId id, ScenePoint& point) {
    const int first = keyframe - static_cast<int>(rng_.Below(6));
    const int last = std::min(num_keyframes_, first + 3 + static_cast<int>(rng_.Below(4)));
    for (int i = std::max(0, first); i < last; ++i) {
      const Eigen::Vector3d in_camera = poses_[i] * point.xyz;
      if (in_camera.z() < kMinDepth) continue;
      const auto pixel = camera.ImageFromCamera(in_camera);
      if (!pixel || pixel->x() < 0.0 || pixel->x() > camera.width || pixel->y() < 0.0 ||
          pixel->y() > camera.height) {
        continue;
      }
      const double noise_x = rng_.Gaussian(0.0, kPixelSigma);
      const Eigen::Vector2d noise(noise_x, rng_.Gaussian(0.0, kPixelSigma));
      Image& image = drive_.model.images.at(ImageId(static_cast<uint32_t>(i + 1)));
      point.track.push_back({image.id, static_cast<uint32_t>(image.points2D.size())});
      image.points2D.push_back({*pixel + noise, id});
    }
  }

  int num_keyframes_;
  int points_per_keyframe_;
  Ring ring_;
  Rng rng_;
  Drive drive_;
  std::vector<Rigid3> poses_;
  int first_ground_ = 0;
};

Eigen::Vector3d GaussianVector(Rng& rng, double sigma) {
  const double x = rng.Gaussian(0.0, sigma);
  const double y = rng.Gaussian(0.0, sigma);
  return {x, y, rng.Gaussian(0.0, sigma)};
}

}  // namespace

Drive MakeDrive(int num_keyframes, int points_per_keyframe, uint64_t seed) {
  return DriveMaker(num_keyframes, points_per_keyframe, seed).Make();
}

void Perturb(uint64_t seed, Reconstruction& model) {
  Rng rng(seed);
  const double shift = 0.01 * MedianDepth(model);
  const double turn = 0.3 * std::numbers::pi / 180.0;
  for (auto& [id, image] : model.images) {
    const Eigen::Vector3d center = image.cam_from_world.CenterInB() + GaussianVector(rng, shift);
    const Eigen::Quaterniond rotation =
        (QuaternionFromRotationVector(GaussianVector(rng, turn)) * image.cam_from_world.rotation)
            .normalized();
    image.cam_from_world = {rotation, -(rotation * center)};
  }
  for (auto& [id, point] : model.points) point.xyz += GaussianVector(rng, shift);
}

}  // namespace s3lam::benchmarks
