#pragma once

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>
#include <vector>

#include "s3lam/base/rng.h"
#include "s3lam/scene/reconstruction.h"

namespace s3lam::testing {

/// A camera of 640 x 480 px and a field of view of about 65 degrees, with visible distortion where
/// the model has any.
inline Camera MakeTestCamera(CameraModel model, CameraId id = CameraId(1)) {
  Camera camera{id, model, 640, 480, {}};
  if (CameraModelHasSingleFocal(model)) {
    camera.params = {500.0, 321.5, 238.25};
  } else {
    camera.params = {500.0, 505.0, 321.5, 238.25};
  }
  const auto add = [&](std::initializer_list<double> distortion) {
    camera.params.insert(camera.params.end(), distortion);
  };
  switch (model) {
    case CameraModel::kSimplePinhole:
    case CameraModel::kPinhole:
      break;
    case CameraModel::kSimpleRadial:
      add({-0.05});
      break;
    case CameraModel::kRadial:
      add({-0.1, 0.03});
      break;
    case CameraModel::kOpenCv:
      add({-0.28, 0.07, 2e-4, -3e-4});
      break;
    case CameraModel::kOpenCvFisheye:
      add({-0.02, 0.005, -0.003, 0.001});
      break;
    case CameraModel::kFullOpenCv:
      add({0.23, -0.78, -1e-3, 2e-3, 0.9, 0.02, -0.05, 0.03});
      break;
    case CameraModel::kFov:
      add({0.6});
      break;
    case CameraModel::kSimpleRadialFisheye:
      add({-0.02});
      break;
    case CameraModel::kRadialFisheye:
      add({-0.03, 0.008});
      break;
  }
  return camera;
}

struct TestSceneOptions {
  int num_images = 6;
  int num_points = 60;
  int num_cameras = 1;      // Images take them in turn.
  double noise_px = 0.5;    // Standard deviation of each keypoint coordinate.
  double visibility = 0.8;  // Probability that an image observes a point it could see.
  int num_unmatched = 2;    // Keypoints per image that observe no point.
  bool planar = false;      // All points on z = 0 (the plane the cameras look down at) instead of
                            // in the cube [-1, 1]^3.
  CameraModel model = CameraModel::kPinhole;
  uint64_t seed = 1;
};

/// Pose of a camera at `center` that looks at `target`, the image's y axis as near to -z of the
/// world as can be.
inline Rigid3 LookAt(const Eigen::Vector3d& center, const Eigen::Vector3d& target) {
  const Eigen::Vector3d forward = (target - center).normalized();
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Matrix3d cam_from_world;
  cam_from_world << right.transpose(), forward.cross(right).transpose(), forward.transpose();
  const Eigen::Quaterniond rotation(cam_from_world);
  return {rotation.normalized(), -(rotation.normalized() * center)};
}

namespace internal {

inline void AddObservation(const Eigen::Vector2d& xy, PointId point_id, Image& image,
                           ScenePoint& point) {
  point.track.push_back({image.id, static_cast<uint32_t>(image.points2D.size())});
  image.points2D.push_back({xy, point_id});
}

/// Keypoints of all points that the image sees and is lucky to observe, then unmatched ones.
inline void ObservePoints(const TestSceneOptions& options, Rng& rng, Reconstruction& scene,
                          Image& image) {
  const Camera& camera = scene.CameraOf(image);
  for (auto& [id, point] : scene.points) {
    const auto xy = camera.ImageFromCamera(image.cam_from_world * point.xyz);
    const Eigen::Vector2d noise(rng.Gaussian(0.0, options.noise_px),
                                rng.Gaussian(0.0, options.noise_px));
    const bool observed = rng.Uniform() < options.visibility;
    if (!xy || !observed) continue;
    const Eigen::Vector2d noisy = *xy + noise;
    const bool inside = noisy.x() >= 0.0 && noisy.y() >= 0.0 && noisy.x() < camera.width &&
                        noisy.y() < camera.height;
    if (inside) AddObservation(noisy, id, image, point);
  }
  for (int i = 0; i < options.num_unmatched; ++i) {
    const double x = rng.Uniform(0.0, camera.width);
    image.points2D.push_back({{x, rng.Uniform(0.0, camera.height)}, kInvalidPointId});
  }
}

/// Removes points that fewer than two images observe.
inline void DropWeakPoints(Reconstruction& scene) {
  for (auto it = scene.points.begin(); it != scene.points.end();) {
    if (it->second.track.size() >= 2) {
      ++it;
      continue;
    }
    for (const TrackElement& element : it->second.track) {
      scene.images.at(element.image_id).points2D[element.point2D_index].point_id = kInvalidPointId;
    }
    it = scene.points.erase(it);
  }
}

}  // namespace internal

/// Cameras on a quarter circle of radius 4 about the origin, 1.5 to 2.5 above z = 0, looking at the
/// origin; every point has at least two observations. Poses and points are the truth, keypoints
/// have noise, point errors are set. The same options give the same scene on every machine.
inline Reconstruction MakeTestScene(const TestSceneOptions& options = {}) {
  Rng rng(options.seed);
  Reconstruction scene;
  for (int i = 0; i < options.num_cameras; ++i) {
    const CameraId id(static_cast<uint32_t>(1 + 2 * i));  // Ids with gaps, as in real models.
    scene.cameras[id] = MakeTestCamera(options.model, id);
    scene.cameras[id].params[0] += 10.0 * i;
  }
  for (int i = 0; i < options.num_points; ++i) {
    ScenePoint& point = scene.points[PointId(static_cast<uint64_t>(10 + 7 * i))];
    for (double& coordinate : point.xyz) coordinate = rng.Uniform(-1.0, 1.0);
    if (options.planar) point.xyz.z() = 0.0;
    for (uint8_t& channel : point.color) channel = static_cast<uint8_t>(rng.Below(256));
  }
  for (int i = 0; i < options.num_images; ++i) {
    const double angle = 0.5 * std::numbers::pi * i / std::max(1, options.num_images - 1);
    const double height = rng.Uniform(1.5, 2.5);
    Image image;
    image.id = ImageId(static_cast<uint32_t>(2 + 3 * i));
    image.camera_id = CameraId(static_cast<uint32_t>(1 + 2 * (i % options.num_cameras)));
    image.name = fmt::format("part{}/frame_{:04d}.png", i % 2, i);
    image.cam_from_world =
        LookAt({4.0 * std::cos(angle), 4.0 * std::sin(angle), height}, Eigen::Vector3d::Zero());
    internal::ObservePoints(options, rng, scene, image);
    scene.images[image.id] = std::move(image);
  }
  internal::DropWeakPoints(scene);
  UpdatePointErrors(scene);
  return scene;
}

struct Perturbation {
  double rotation_rad = 0.0;  // Standard deviations, per axis.
  double translation = 0.0;
  double point = 0.0;
  uint64_t seed = 7;
};

/// Moves poses and points at random, for tests that find the way back.
inline void PerturbScene(const Perturbation& perturbation, Reconstruction& scene) {
  Rng rng(perturbation.seed);
  const auto random = [&](double sigma) {
    const double x = rng.Gaussian(0.0, sigma);
    const double y = rng.Gaussian(0.0, sigma);
    return Eigen::Vector3d(x, y, rng.Gaussian(0.0, sigma));
  };
  for (auto& [id, image] : scene.images) {
    const Eigen::Vector3d center =
        image.cam_from_world.CenterInB() + random(perturbation.translation);
    Eigen::Quaterniond& rotation = image.cam_from_world.rotation;
    rotation =
        (QuaternionFromRotationVector(random(perturbation.rotation_rad)) * rotation).normalized();
    image.cam_from_world.translation = -(rotation * center);
  }
  for (auto& [id, point] : scene.points) point.xyz += random(perturbation.point);
}

/// True if both hold the same numbers, to the last bit, in the same order.
inline bool Identical(const Reconstruction& a, const Reconstruction& b) {
  const auto same_map = [](const auto& x, const auto& y, const auto& same) {
    return std::equal(x.begin(), x.end(), y.begin(), y.end(), [&](const auto& s, const auto& t) {
      return s.first == t.first && same(s.second, t.second);
    });
  };
  const auto same_camera = [](const Camera& x, const Camera& y) {
    return x.id == y.id && x.model == y.model && x.width == y.width && x.height == y.height &&
           x.params == y.params;
  };
  const auto same_keypoint = [](const Point2D& x, const Point2D& y) {
    return x.xy == y.xy && x.point_id == y.point_id;
  };
  const auto same_image = [&](const Image& x, const Image& y) {
    return x.id == y.id && x.camera_id == y.camera_id && x.name == y.name &&
           x.cam_from_world.rotation.coeffs() == y.cam_from_world.rotation.coeffs() &&
           x.cam_from_world.translation == y.cam_from_world.translation &&
           std::equal(x.points2D.begin(), x.points2D.end(), y.points2D.begin(), y.points2D.end(),
                      same_keypoint);
  };
  const auto same_point = [](const ScenePoint& x, const ScenePoint& y) {
    return x.xyz == y.xyz && x.color == y.color && x.error == y.error && x.track == y.track;
  };
  return same_map(a.cameras, b.cameras, same_camera) && same_map(a.images, b.images, same_image) &&
         same_map(a.points, b.points, same_point);
}

}  // namespace s3lam::testing
