#include "s3lam/scene/reconstruction.h"

#include <algorithm>
#include <cmath>

#include "s3lam/base/error.h"
#include "s3lam/base/statistics.h"

namespace s3lam {

size_t Reconstruction::NumObservations() const {
  size_t count = 0;
  for (const auto& [id, point] : points) count += point.track.size();
  return count;
}

namespace {

/// Which keypoints of each image have been met in a track.
using TrackedKeypoints = std::map<ImageId, std::vector<bool>>;

void CheckImage(const Reconstruction& reconstruction, const Image& image,
                const std::string& source) {
  if (!reconstruction.cameras.contains(image.camera_id)) {
    ThrowInputError("{}: image {} ({}) has unknown camera {}", source, image.id.value(), image.name,
                    image.camera_id.value());
  }
  const Rigid3& pose = image.cam_from_world;
  if (!pose.rotation.coeffs().allFinite() || !pose.translation.allFinite()) {
    ThrowInputError("{}: image {} ({}) has a pose that is not finite", source, image.id.value(),
                    image.name);
  }
  if (std::abs(pose.rotation.norm() - 1.0) > 1e-3) {
    ThrowInputError("{}: image {} ({}) has a quaternion of norm {}", source, image.id.value(),
                    image.name, pose.rotation.norm());
  }
  for (size_t i = 0; i < image.points2D.size(); ++i) {
    const Point2D& point2D = image.points2D[i];
    if (!point2D.xy.allFinite()) {
      ThrowInputError("{}: image {} keypoint {} is not finite", source, image.id.value(), i);
    }
  }
}

void CheckPoint(const Reconstruction& reconstruction, PointId id, const ScenePoint& point,
                TrackedKeypoints& tracked, const std::string& source) {
  if (!point.xyz.allFinite()) {
    ThrowInputError("{}: point {} is not finite", source, id.value());
  }
  for (const TrackElement& element : point.track) {
    const auto image = reconstruction.images.find(element.image_id);
    if (image == reconstruction.images.end()) {
      ThrowInputError("{}: point {} is observed by image {}, which does not exist", source,
                      id.value(), element.image_id.value());
    }
    if (element.point2D_index >= image->second.points2D.size()) {
      ThrowInputError("{}: point {} refers to keypoint {} of image {}, which has {}", source,
                      id.value(), element.point2D_index, element.image_id.value(),
                      image->second.points2D.size());
    }
    if (image->second.points2D[element.point2D_index].point_id != id) {
      ThrowInputError("{}: point {} and keypoint {} of image {} do not refer to each other", source,
                      id.value(), element.point2D_index, element.image_id.value());
    }
    std::vector<bool>::reference met = tracked.at(element.image_id)[element.point2D_index];
    if (met) {
      ThrowInputError("{}: keypoint {} of image {} is twice in the track of point {}", source,
                      element.point2D_index, element.image_id.value(), id.value());
    }
    met = true;
  }
}

/// Every keypoint that observes a point has to be in that point's track.
void CheckAllTracked(const Reconstruction& reconstruction, const Image& image,
                     const std::vector<bool>& tracked, const std::string& source) {
  for (size_t i = 0; i < image.points2D.size(); ++i) {
    const PointId id = image.points2D[i].point_id;
    if (!id.valid() || tracked[i]) continue;
    const bool exists = reconstruction.points.contains(id);
    ThrowInputError("{}: image {} keypoint {} observes point {}, which {}", source,
                    image.id.value(), i, id.value(),
                    exists ? "does not have it in its track" : "does not exist");
  }
}

}  // namespace

void CheckReconstruction(const Reconstruction& reconstruction, const std::string& source) {
  for (const auto& [id, camera] : reconstruction.cameras) {
    camera.Check(fmt::format("{}: camera {}", source, id.value()));
  }
  TrackedKeypoints tracked;
  for (const auto& [id, image] : reconstruction.images) {
    CheckImage(reconstruction, image, source);
    tracked.emplace_hint(tracked.end(), id, std::vector<bool>(image.points2D.size()));
  }
  for (const auto& [id, point] : reconstruction.points) {
    CheckPoint(reconstruction, id, point, tracked, source);
  }
  for (const auto& [id, image] : reconstruction.images) {
    CheckAllTracked(reconstruction, image, tracked.at(id), source);
  }
}

namespace {

/// Reprojection error [px], or empty for an observation from behind.
std::optional<double> ReprojectionError(const Reconstruction& reconstruction,
                                        const ScenePoint& point, const TrackElement& element) {
  const Image& image = reconstruction.images.at(element.image_id);
  const auto xy = reconstruction.CameraOf(image).ImageFromCamera(image.cam_from_world * point.xyz);
  if (!xy) return std::nullopt;
  return (*xy - image.points2D[element.point2D_index].xy).norm();
}

}  // namespace

void UpdatePointErrors(Reconstruction& reconstruction) {
  for (auto& [id, point] : reconstruction.points) {
    double sum = 0.0;
    for (const TrackElement& element : point.track) {
      const Camera& camera = reconstruction.CameraOf(reconstruction.images.at(element.image_id));
      sum += ReprojectionError(reconstruction, point, element)
                 .value_or(std::hypot(camera.width, camera.height));
    }
    point.error = point.track.empty() ? -1.0 : sum / static_cast<double>(point.track.size());
  }
}

ReprojectionStatistics ComputeReprojectionStatistics(const Reconstruction& reconstruction) {
  ReprojectionStatistics statistics;
  double sum_squared = 0.0;
  double sum_of_means = 0.0;
  size_t num_points = 0;
  for (const auto& [id, point] : reconstruction.points) {
    double sum = 0.0;
    size_t count = 0;
    for (const TrackElement& element : point.track) {
      const auto error = ReprojectionError(reconstruction, point, element);
      if (!error) {
        ++statistics.num_behind;
        continue;
      }
      sum += *error;
      sum_squared += *error * *error;
      ++count;
    }
    if (count == 0) continue;
    statistics.num_observations += count;
    sum_of_means += sum / static_cast<double>(count);
    ++num_points;
  }
  if (num_points == 0) return statistics;
  statistics.rms_px = std::sqrt(sum_squared / static_cast<double>(statistics.num_observations));
  statistics.mean_px = sum_of_means / static_cast<double>(num_points);
  return statistics;
}

void TransformReconstruction(const Similarity3& new_from_old, Reconstruction& reconstruction) {
  for (auto& [id, image] : reconstruction.images) {
    image.cam_from_world = TransformCameraPose(new_from_old, image.cam_from_world);
  }
  for (auto& [id, point] : reconstruction.points) point.xyz = new_from_old * point.xyz;
}

double MedianDepth(const Reconstruction& reconstruction) {
  std::vector<double> depths;
  for (const auto& [id, point] : reconstruction.points) {
    for (const TrackElement& element : point.track) {
      const Image& image = reconstruction.images.at(element.image_id);
      depths.push_back((image.cam_from_world * point.xyz).z());
    }
  }
  return Median(std::move(depths));
}

}  // namespace s3lam
