#include "s3lam/synthetic/synthetic_map.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "s3lam/base/error.h"
#include "s3lam/base/options_json.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/rng.h"
#include "s3lam/geometry/similarity3.h"
#include "s3lam/synthetic/ray_cast.h"
#include "synthetic_semantics.h"

namespace s3lam {
namespace {

constexpr size_t kMinTrackLength = 3;
constexpr double kOnPlaneTolerance_m = 1e-6;
constexpr double kRadPerDeg = std::numbers::pi / 180.0;

// Streams of the seed, so that one option does not disturb what others draw.
enum Stream : uint64_t { kFind = 1, kPixels, kOutliers, kPoses, kPoints, kDrift };

struct Sighting {
  size_t image;
  Eigen::Vector2d xy;
};

// A point before it gets an id.
struct FoundPoint {
  bool valid = false;
  Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
  int object = 0;
  size_t finder = 0;
  std::vector<Sighting> sightings;
};

bool InImage(const Camera& camera, const Eigen::Vector2d& xy) {
  return xy.x() >= 0.0 && xy.y() >= 0.0 && xy.x() <= camera.width && xy.y() <= camera.height;
}

// Pixel of a point that must also come back to the same ray: beyond the field of view a strong
// distortion folds points into the image.
std::optional<Eigen::Vector2d> ProjectInside(const Camera& camera, const Eigen::Vector3d& xyz) {
  if (!(xyz.z() > 0.05)) return std::nullopt;
  const double max_slope =
      0.75 * std::hypot(camera.width / camera.FocalX(), camera.height / camera.FocalY());
  if (xyz.head<2>().norm() > max_slope * xyz.z()) return std::nullopt;
  std::optional<Eigen::Vector2d> xy = camera.ImageFromCamera(xyz);
  if (!xy || !InImage(camera, *xy)) return std::nullopt;
  return xy;
}

FoundPoint FindPoint(const Scene& scene, const RayCaster& caster,
                     const std::vector<Rigid3>& world_from_cameras, int window, Rng rng) {
  FoundPoint point;
  point.finder = rng.Below(world_from_cameras.size());
  const Rigid3& world_from_camera = world_from_cameras[point.finder];
  const Eigen::Vector2d pixel(rng.Uniform(0.0, scene.camera.width),
                              rng.Uniform(0.0, scene.camera.height));
  const std::optional<Eigen::Vector2d> ray = scene.camera.CameraFromImage(pixel);
  if (!ray) return point;
  const std::optional<RayHit> hit =
      caster.Cast(world_from_camera.translation, world_from_camera.rotation * ray->homogeneous());
  if (!hit) return point;
  point.xyz = world_from_camera * (hit->depth * ray->homogeneous());
  point.object = scene.surfaces[static_cast<size_t>(hit->surface)].object;
  const size_t reach = window > 0 ? static_cast<size_t>(window) : world_from_cameras.size();
  const size_t begin = point.finder - std::min(point.finder, reach);
  const size_t end = std::min(world_from_cameras.size(), point.finder + reach + 1);
  for (size_t i = begin; i < end; ++i) {
    const auto xy = ProjectInside(scene.camera, world_from_cameras[i].Inverse() * point.xyz);
    if (!xy || !caster.Sees(world_from_cameras[i].translation, point.xyz)) continue;
    point.sightings.push_back({i, *xy});
  }
  point.valid = point.sightings.size() >= kMinTrackLength;
  return point;
}

void AddImages(const Scene& scene, const std::vector<Rigid3>& world_from_cameras,
               const std::vector<int>& frames, Reconstruction& model) {
  model.cameras.emplace(scene.camera.id, scene.camera);
  for (size_t i = 0; i < frames.size(); ++i) {
    Image image;
    image.id = ImageId(static_cast<uint32_t>(i + 1));
    image.camera_id = scene.camera.id;
    image.name = fmt::format("frame-{:06d}.png", frames[i]);
    image.cam_from_world = world_from_cameras[i].Inverse();
    model.images.emplace(image.id, std::move(image));
  }
}

Eigen::Vector2d Disturbed(const Eigen::Vector2d& xy, const SyntheticMapOptions& options,
                          Rng& pixels, Rng& outliers) {
  Eigen::Vector2d noisy =
      xy + options.pixel_sigma * Eigen::Vector2d(pixels.Gaussian(), pixels.Gaussian());
  const bool is_outlier = outliers.Uniform() < options.outlier_fraction;
  const double angle = outliers.Uniform(0.0, 2.0 * std::numbers::pi);
  const double length = outliers.Uniform(5.0, 50.0);
  if (is_outlier) noisy += length * Eigen::Vector2d(std::cos(angle), std::sin(angle));
  return noisy;
}

void AddPoint(const Scene& scene, const FoundPoint& found, const SyntheticMapOptions& options,
              Rng& pixels, Rng& outliers, SyntheticMap& map) {
  const PointId id(map.truth.points.size() + 1);
  ScenePoint point;
  point.xyz = found.xyz;
  const SceneObject& object = scene.objects[static_cast<size_t>(found.object)];
  const std::optional<int> class_index = scene.class_table.IndexOfId(object.class_id);
  point.color = scene.class_table.classes[static_cast<size_t>(*class_index)].color;
  for (const Sighting& sighting : found.sightings) {
    Image& image = map.truth.images.at(ImageId(static_cast<uint32_t>(sighting.image + 1)));
    point.track.push_back({image.id, static_cast<uint32_t>(image.points2D.size())});
    image.points2D.push_back({Disturbed(sighting.xy, options, pixels, outliers), id});
  }
  map.truth.points.emplace(id, std::move(point));
  map.object_of_point[id] = object.id;
  map.on_plane[id] =
      object.plane_in_world && std::abs(object.plane_in_world->SignedDistance(found.xyz)) <
                                   object.flatness_m + kOnPlaneTolerance_m;
}

// Random walk of similarities about the cameras' own centres: drifted_from_true of each image.
std::vector<Similarity3> WalkDrift(const std::vector<Rigid3>& world_from_cameras,
                                   const SyntheticMapOptions& options, double median_depth,
                                   Rng rng) {
  std::vector<Similarity3> drifted_from_true;
  Similarity3 current;
  for (size_t i = 0; i < world_from_cameras.size(); ++i) {
    const Eigen::Vector3d& center = world_from_cameras[i].translation;
    const auto random = [&] {
      return Eigen::Vector3d(rng.Gaussian(), rng.Gaussian(), rng.Gaussian());
    };
    const Eigen::Vector3d rotation = options.drift_rotation_deg * kRadPerDeg * random();
    const Eigen::Vector3d shift = options.drift_translation * median_depth * random();
    const double log_scale = rng.Gaussian(options.drift_scale_trend, options.drift_scale);
    if (i > 0) {
      Similarity3 step;
      step.scale = std::exp(log_scale);
      step.rotation = QuaternionFromRotationVector(rotation);
      step.translation = center + shift - step.scale * (step.rotation * center);
      current = current * step;
    }
    drifted_from_true.push_back(current);
  }
  return drifted_from_true;
}

void DisturbEstimate(const std::vector<Rigid3>& world_from_cameras,
                     const std::vector<size_t>& finder_of_point, const SyntheticMapOptions& options,
                     const Rng& rng, Reconstruction& estimate) {
  const double depth = MedianDepth(estimate);
  const std::vector<Similarity3> drift =
      WalkDrift(world_from_cameras, options, depth, rng.Fork(kDrift));
  Similarity3 units;
  units.scale = options.map_scale;
  Rng poses = rng.Fork(kPoses);
  size_t index = 0;
  for (auto& [id, image] : estimate.images) {
    image.cam_from_world = TransformCameraPose(units * drift[index++], image.cam_from_world);
    const auto random = [&](double sigma) {
      return Eigen::Vector3d(poses.Gaussian(0.0, sigma), poses.Gaussian(0.0, sigma),
                             poses.Gaussian(0.0, sigma));
    };
    const Eigen::Quaterniond turn =
        QuaternionFromRotationVector(random(options.rotation_sigma_deg * kRadPerDeg));
    const Eigen::Vector3d center =
        image.cam_from_world.CenterInB() + random(options.center_sigma * depth * options.map_scale);
    image.cam_from_world.rotation = (turn * image.cam_from_world.rotation).normalized();
    image.cam_from_world.translation = -(image.cam_from_world.rotation * center);
  }
  Rng points = rng.Fork(kPoints);
  index = 0;
  for (auto& [id, point] : estimate.points) {
    const double sigma = options.point_sigma * depth * options.map_scale;
    point.xyz = units * drift[finder_of_point[index++]] * point.xyz;
    point.xyz += sigma * Eigen::Vector3d(points.Gaussian(), points.Gaussian(), points.Gaussian());
  }
}

}  // namespace

Plane FitPlaneToPoints(const std::vector<Eigen::Vector3d>& points,
                       const Eigen::Vector3d& viewpoint) {
  S3LAM_CHECK(points.size() >= 3);
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& point : points) centroid += point;
  centroid /= static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& point : points) {
    scatter += (point - centroid) * (point - centroid).transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
  Plane plane;
  plane.normal = solver.eigenvectors().col(0);
  if (plane.normal.dot(viewpoint - centroid) < 0.0) plane.normal = -plane.normal;
  plane.offset = -plane.normal.dot(centroid);
  return plane;
}

SyntheticMap MakeSyntheticMap(const Scene& scene, uint64_t seed, const SyntheticMapOptions& options,
                              int num_threads) {
  CheckOptions(options);
  std::vector<int> frames;
  std::vector<Rigid3> world_from_cameras;
  for (int i = 0; i < options.num_images; ++i) {
    // Real-valued times: there may be more images than the scene has frames.
    const double time_s = scene.path.duration_s() * i / (options.num_images - 1);
    frames.push_back(i);
    world_from_cameras.push_back(scene.path.WorldFromCamera(time_s));
  }
  const Rng rng(seed);
  const RayCaster caster(scene);
  std::vector<FoundPoint> found(static_cast<size_t>(options.num_points));
  const Rng find = rng.Fork(kFind);
  ParallelFor(found.size(), num_threads, [&](size_t i) {
    found[i] = FindPoint(scene, caster, world_from_cameras, options.max_track_window, find.Fork(i));
  });

  SyntheticMap map;
  AddImages(scene, world_from_cameras, frames, map.truth);
  Rng pixels = rng.Fork(kPixels);
  Rng outliers = rng.Fork(kOutliers);
  std::vector<size_t> finder_of_point;
  for (const FoundPoint& point : found) {
    if (!point.valid) continue;
    AddPoint(scene, point, options, pixels, outliers, map);
    finder_of_point.push_back(point.finder);
  }
  map.estimate = map.truth;
  DisturbEstimate(world_from_cameras, finder_of_point, options, rng, map.estimate);
  UpdatePointErrors(map.truth);
  UpdatePointErrors(map.estimate);
  synthetic::AddSemantics(scene, seed, options, map);
  return map;
}

SyntheticMap MakeSyntheticMap(const std::string& scene_name, uint64_t seed,
                              const SyntheticMapOptions& options, int num_threads) {
  return MakeSyntheticMap(MakeScene(scene_name, seed), seed, options, num_threads);
}

}  // namespace s3lam
