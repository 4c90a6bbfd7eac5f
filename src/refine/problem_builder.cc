#include "s3lam/refine/problem_builder.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "s3lam/base/error.h"
#include "s3lam/base/statistics.h"
#include "s3lam/refine/projection.h"

namespace s3lam {
namespace {

std::vector<Rigid3> PosesOf(const BundleProblem& problem) {
  std::vector<Rigid3> poses;
  poses.reserve(problem.poses.size());
  for (const PoseBlock& pose : problem.poses) poses.push_back(FromPoseBlock(pose.data()));
  return poses;
}

void SetRelativeSigmas(const KeypointSigmas& sigmas, BundleMap& map) {
  std::vector<double> all;
  for (size_t k = 0; k < map.elements.size(); ++k) {
    const TrackElement& element = map.elements[k];
    const double sigma = sigmas.at(element.image_id).at(element.point2D_index);
    map.observations[k].sigma = sigma;
    all.push_back(sigma);
  }
  const double median = Median(std::move(all));
  for (BundleObservation& o : map.observations) o.sigma /= median;
}

constexpr double kLeastSigma = 0.05;  // [px]

/// From the lengths of reprojection errors.
double KeypointSigma(std::vector<double> errors) {
  return std::max(kLeastSigma, Median(std::move(errors)) / kMedianOfRayleigh);
}

/// Calls `use` for the observations that can be projected of points that have two or more, with the
/// length of the error [px] that it would have if its point had not been fitted to it.
template <typename Use>
void ForEachError(const BundleMap& map, Use&& use) {
  const BundleProblem& problem = map.problem;
  const std::vector<Rigid3> poses = PosesOf(problem);
  const auto& observations = map.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const int point = observations[begin].point;
    while (end < observations.size() && observations[end].point == point) ++end;
    if (end - begin < 2) continue;
    const double correction = ResidualCorrection(end - begin);
    for (size_t k = begin; k < end; ++k) {
      const BundleObservation& o = observations[k];
      const Camera& camera = problem.cameras[problem.camera_of_pose[o.pose]];
      Eigen::Vector2d pixel;
      if (ProjectPoint(camera.model, camera.params.data(), poses[o.pose] * problem.points[point],
                       &pixel, nullptr)) {
        use(o, correction * (pixel - o.pixel).norm());
      }
    }
  }
}

double LargerSide(const Camera& camera) { return std::max(camera.width, camera.height); }

/// Per camera: the sigma of its keypoints as a part of that of all, by its errors if there are
/// enough of them, else by the size of its images; empty if there are no errors.
std::vector<double> RelativeSigmasOfCameras(size_t least_errors, const BundleMap& map) {
  const BundleProblem& problem = map.problem;
  std::vector<std::vector<double>> errors(problem.cameras.size());
  std::vector<double> all;
  std::vector<double> sides;
  ForEachError(map, [&](const BundleObservation& o, double error) {
    const int camera = problem.camera_of_pose[o.pose];
    errors[camera].push_back(error);
    all.push_back(error);
    sides.push_back(LargerSide(problem.cameras[camera]));
  });
  if (all.empty()) return {};
  const double sigma = KeypointSigma(std::move(all));
  const double side = Median(std::move(sides));
  std::vector<double> relative;
  for (size_t c = 0; c < errors.size(); ++c) {
    relative.push_back(errors[c].size() >= least_errors
                           ? KeypointSigma(std::move(errors[c])) / sigma
                           : LargerSide(problem.cameras[c]) / side);
  }
  return relative;
}

/// Returns the largest part that a sigma changed by.
double SetSigmasOfCameras(size_t least_errors, BundleMap& map) {
  if (map.keypoints_differ) return 0.0;
  const std::vector<double> sigmas = RelativeSigmasOfCameras(least_errors, map);
  if (sigmas.empty()) return 0.0;
  double change = 0.0;
  for (auto* observations : {&map.observations, &map.problem.observations}) {
    for (BundleObservation& o : *observations) {
      const double sigma = sigmas[map.problem.camera_of_pose[o.pose]];
      change = std::max(change, std::abs(sigma / o.sigma - 1.0));
      o.sigma = sigma;
    }
  }
  return change;
}

/// Leaves out observations of points and images that have too few, until none is left to remove.
size_t RemoveUnderdetermined(int min_image_observations, const BundleMap& map,
                             std::vector<uint8_t>& use) {
  size_t removed = 0;
  std::vector<int> of_image(map.image_ids.size(), 0);
  for (size_t k = 0; k < use.size(); ++k) of_image[map.observations[k].pose] += use[k];
  bool again = true;
  while (again) {
    again = false;
    for (size_t begin = 0, end = 0; begin < use.size(); begin = end) {
      const int point = map.observations[begin].point;
      int first_pose = -1;
      bool two_images = false;
      for (end = begin; end < use.size() && map.observations[end].point == point; ++end) {
        const int pose = map.observations[end].pose;
        if (use[end] != 0 && of_image[pose] < min_image_observations) {
          use[end] = 0;
          ++removed;
        }
        if (use[end] == 0) continue;
        two_images |= first_pose >= 0 && pose != first_pose;
        first_pose = pose;
      }
      if (two_images || first_pose < 0) continue;
      for (size_t k = begin; k < end; ++k) {
        if (use[k] == 0) continue;
        use[k] = 0;
        ++removed;
        // An image may fall below its minimum by this.
        again |= --of_image[map.observations[k].pose] == min_image_observations - 1;
      }
    }
  }
  return removed;
}

}  // namespace

void OutlierOptions::Visit(OptionVisitor& v) {
  v.Value("max_reprojection_sigma", max_reprojection_sigma,
          "observations with a larger reprojection error after a solve are left out [sigma]", 1.0,
          1e9);
  v.Value("min_depth_ratio", min_depth_ratio,
          "observations nearer than this part of the map's median depth are left out", 0.0, 1.0);
  v.Value("min_image_observations", min_image_observations,
          "images that see fewer points are carried along with their neighbours", 3, 1000000);
}

int BundleMap::IndexOfPoint(PointId id) const {
  const auto it = std::lower_bound(point_ids.begin(), point_ids.end(), id);
  return it != point_ids.end() && *it == id ? static_cast<int>(it - point_ids.begin()) : -1;
}

BundleMap BuildBundleMap(const Reconstruction& reconstruction, const KeypointSigmas& sigmas) {
  BundleMap map;
  std::map<CameraId, int> camera_index;
  for (const auto& [id, camera] : reconstruction.cameras) {
    camera_index[id] = static_cast<int>(map.problem.cameras.size());
    map.problem.cameras.push_back(camera);
    map.camera_ids.push_back({id});
  }
  std::map<ImageId, int> image_index;
  for (const auto& [id, image] : reconstruction.images) {
    image_index[id] = static_cast<int>(map.image_ids.size());
    map.image_ids.push_back(id);
    map.problem.poses.push_back(ToPoseBlock(image.cam_from_world));
    map.problem.camera_of_pose.push_back(camera_index.at(image.camera_id));
  }
  map.problem.pose_is_constant.assign(map.image_ids.size(), 0);
  for (const auto& [id, point] : reconstruction.points) {
    const int index = static_cast<int>(map.point_ids.size());
    map.point_ids.push_back(id);
    map.problem.points.push_back(point.xyz);
    std::vector<TrackElement> track = point.track;
    std::sort(track.begin(), track.end());
    for (const TrackElement& element : track) {
      const Image& image = reconstruction.images.at(element.image_id);
      map.elements.push_back(element);
      map.observations.push_back(
          {image_index.at(element.image_id), index, image.points2D[element.point2D_index].xy});
    }
  }
  map.keypoints_differ = !sigmas.empty();
  if (map.keypoints_differ) SetRelativeSigmas(sigmas, map);
  // What errors tell before a solve may be of poor poses.
  SetSigmasOfCameras(std::numeric_limits<size_t>::max(), map);
  map.is_used.assign(map.observations.size(), 0);
  return map;
}

ObservationCounts SelectObservations(const OutlierOptions& options, double sigma_px,
                                     bool keep_large_errors, BundleMap& map) {
  BundleProblem& problem = map.problem;
  const std::vector<Rigid3> poses = PosesOf(problem);
  ObservationCounts counts;
  counts.total = map.observations.size();
  std::vector<Eigen::Vector3d> in_camera(counts.total);
  std::vector<double> depths;
  for (size_t k = 0; k < counts.total; ++k) {
    const BundleObservation& o = map.observations[k];
    in_camera[k] = poses[o.pose] * problem.points[o.point];
    if (in_camera[k].z() > 0.0) depths.push_back(in_camera[k].z());
  }
  const double min_depth = options.min_depth_ratio * Median(depths);
  std::vector<uint8_t> use(counts.total, 0);
  for (size_t k = 0; k < counts.total; ++k) {
    const BundleObservation& o = map.observations[k];
    const Camera& camera = problem.cameras[problem.camera_of_pose[o.pose]];
    Eigen::Vector2d pixel;
    if (in_camera[k].z() < min_depth ||
        !ProjectPoint(camera.model, camera.params.data(), in_camera[k], &pixel, nullptr)) {
      ++counts.behind;
    } else if (!keep_large_errors &&
               (pixel - o.pixel).norm() > options.max_reprojection_sigma * sigma_px * o.sigma) {
      ++counts.outliers;
    } else {
      use[k] = 1;
    }
  }
  counts.too_few = RemoveUnderdetermined(options.min_image_observations, map, use);
  problem.observations.clear();
  for (size_t k = 0; k < counts.total; ++k) {
    counts.changed += use[k] != map.is_used[k];
    if (use[k] != 0) problem.observations.push_back(map.observations[k]);
  }
  counts.used = problem.observations.size();
  map.is_used = std::move(use);
  return counts;
}

Gauge ChooseGauge(const BundleProblem& problem, int fixed_pose) {
  const std::vector<uint8_t> used = problem.UsedPoses();
  Gauge gauge{fixed_pose, -1};
  double largest = 0.0;
  for (int i = 0; i < static_cast<int>(used.size()); ++i) {
    if (used[i] == 0) continue;
    if (gauge.fixed_pose < 0) gauge.fixed_pose = i;
    const double distance = (problem.CenterOf(i) - problem.CenterOf(gauge.fixed_pose)).norm();
    if (distance <= largest) continue;
    gauge.scale_pose = i;
    largest = distance;
  }
  return gauge;
}

double MeasureCameraSigmas(BundleMap& map) {
  constexpr size_t kLeastErrors = 500;
  return SetSigmasOfCameras(kLeastErrors, map);
}

double MeasureKeypointSigma(const BundleMap& map) {
  std::vector<double> errors;
  ForEachError(
      map, [&](const BundleObservation& o, double error) { errors.push_back(error / o.sigma); });
  return KeypointSigma(std::move(errors));
}

std::vector<Eigen::Matrix3d> TriangulationCovariances(const BundleProblem& problem,
                                                      double sigma_px) {
  const std::vector<Rigid3> poses = PosesOf(problem);
  std::vector<Eigen::Matrix3d> covariances(problem.points.size(), Eigen::Matrix3d::Zero());
  for (const BundleObservation& o : problem.observations) {
    const Camera& camera = problem.cameras[problem.camera_of_pose[o.pose]];
    Eigen::Vector2d pixel;
    Matrix23 by_point;
    if (!ProjectPoint(camera.model, camera.params.data(), poses[o.pose] * problem.points[o.point],
                      &pixel, &by_point)) {
      continue;
    }
    const Matrix23 j = by_point * poses[o.pose].rotation.toRotationMatrix() / (sigma_px * o.sigma);
    covariances[o.point].noalias() += j.transpose() * j;
  }
  for (Eigen::Matrix3d& matrix : covariances) {
    if (matrix.isZero(0.0)) continue;
    // Where the rays are nearly parallel the depth is unknown: the damping keeps it finite.
    matrix.diagonal().array() += 1e-12 * matrix.trace();
    matrix = matrix.inverse().eval();
  }
  return covariances;
}

namespace {

/// Median over each point's observations of `size_of`(observation, its camera, depth in it); zero
/// for a point without observations.
template <typename SizeOf>
std::vector<double> MedianSizes(const BundleProblem& problem, SizeOf&& size_of) {
  const std::vector<Rigid3> poses = PosesOf(problem);
  std::vector<double> sizes(problem.points.size(), 0.0);
  std::vector<double> of_point;
  const auto& observations = problem.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const int point = observations[begin].point;
    of_point.clear();
    for (end = begin; end < observations.size() && observations[end].point == point; ++end) {
      const int pose = observations[end].pose;
      of_point.push_back(size_of(observations[end], problem.cameras[problem.camera_of_pose[pose]],
                                 (poses[pose] * problem.points[point]).z()));
    }
    sizes[point] = Median(of_point);
  }
  return sizes;
}

}  // namespace

std::vector<double> DepthsOfPoints(const BundleProblem& problem) {
  return MedianSizes(problem,
                     [](const BundleObservation&, const Camera&, double depth) { return depth; });
}

std::vector<double> PixelSizes(const BundleProblem& problem) {
  return MedianSizes(problem, [](const BundleObservation&, const Camera& camera, double depth) {
    return depth / camera.MeanFocal();
  });
}

std::vector<double> KeypointSizes(const BundleProblem& problem) {
  return MedianSizes(problem, [](const BundleObservation& o, const Camera& camera, double depth) {
    return o.sigma * depth / camera.MeanFocal();
  });
}

Reconstruction ToReconstruction(const BundleMap& map, const Reconstruction& original) {
  Reconstruction result = original;
  for (size_t c = 0; c < map.camera_ids.size(); ++c) {
    for (const CameraId id : map.camera_ids[c]) {
      Camera& camera = result.cameras.at(id);
      camera.model = map.problem.cameras[c].model;
      camera.params = map.problem.cameras[c].params;
    }
  }
  for (size_t i = 0; i < map.image_ids.size(); ++i) {
    if (map.problem.pose_is_constant[i] != 0) continue;  // To the last bit.
    result.images.at(map.image_ids[i]).cam_from_world = FromPoseBlock(map.problem.poses[i].data());
  }
  for (size_t j = 0; j < map.point_ids.size(); ++j) {
    ScenePoint& point = result.points.at(map.point_ids[j]);
    point.xyz = map.problem.points[j];
    point.track.clear();
  }
  for (size_t k = 0; k < map.observations.size(); ++k) {
    const TrackElement& element = map.elements[k];
    const PointId id =
        map.is_used[k] != 0 ? map.point_ids[map.observations[k].point] : kInvalidPointId;
    result.images.at(element.image_id).points2D[element.point2D_index].point_id = id;
    if (id.valid()) result.points.at(id).track.push_back(element);
  }
  for (size_t j = 0; j < map.point_ids.size(); ++j) {
    const bool is_held = map.problem.IsConstantPoint(static_cast<int>(j));
    const auto point = result.points.find(map.point_ids[j]);
    if (point->second.track.empty() && !is_held) result.points.erase(point);
  }
  UpdatePointErrors(result);
  return result;
}

}  // namespace s3lam
