#include "s3lam/report/measures.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "s3lam/base/statistics.h"

namespace s3lam::report {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// Error of the keypoint in one arm; empty if the arm does not have the observation or it is behind
/// the camera.
std::optional<double> ErrorInArm(const Reconstruction& model, ImageId image_id, size_t index,
                                 PointId point_id) {
  const auto image = model.images.find(image_id);
  if (image == model.images.end() || index >= image->second.points2D.size()) return std::nullopt;
  const Point2D& keypoint = image->second.points2D[index];
  if (keypoint.point_id != point_id) return std::nullopt;
  const auto xy =
      model.CameraOf(image->second)
          .ImageFromCamera(image->second.cam_from_world * model.points.at(point_id).xyz);
  if (!xy) return std::nullopt;
  return (*xy - keypoint.xy).norm();
}

/// The outline of points on the plane, counter-clockwise about the normal.
std::vector<Vector2d> Outline(const PlanarSurface& plane, const std::vector<Vector3d>& points) {
  std::vector<cv::Point2f> uv;
  for (const Vector3d& x : points) {
    const Vector3d arm = x - plane.centroid_in_world;
    uv.emplace_back(static_cast<float>(plane.axis_u_in_world.dot(arm)),
                    static_cast<float>(plane.axis_v_in_world.dot(arm)));
  }
  std::vector<cv::Point2f> hull;
  cv::convexHull(uv, hull);
  std::vector<Vector2d> outline;
  for (const cv::Point2f& p : hull) outline.emplace_back(p.x, p.y);
  return outline;
}

PlanarSurface FitSurface(const PlanarSurface& original, const std::vector<Vector3d>& points) {
  PlanarSurface surface = original;
  Vector3d sum = Vector3d::Zero();
  for (const Vector3d& x : points) sum += x;
  surface.centroid_in_world = sum / static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Vector3d& x : points) {
    const Vector3d arm = x - surface.centroid_in_world;
    scatter += arm * arm.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
  Vector3d normal = solver.eigenvectors().col(0);
  if (normal.dot(original.plane_in_world.normal) < 0.0) normal = -normal;
  surface.plane_in_world = {normal, -normal.dot(surface.centroid_in_world)};
  surface.axis_u_in_world = solver.eigenvectors().col(2);
  surface.axis_v_in_world = normal.cross(surface.axis_u_in_world);
  surface.extent = Outline(surface, points);
  return surface;
}

std::vector<PointId> CommonPoints(const std::vector<PointId>& ids, const std::vector<Arm>& arms) {
  std::vector<PointId> common;
  for (const PointId id : ids) {
    if (std::all_of(arms.begin(), arms.end(),
                    [&](const Arm& arm) { return arm.model.points.contains(id); })) {
      common.push_back(id);
    }
  }
  return common;
}

}  // namespace

std::vector<std::vector<double>> CommonReprojectionErrors(const std::vector<Arm>& arms) {
  std::vector<std::vector<double>> errors(arms.size());
  for (const auto& [image_id, image] : arms.back().model.images) {
    for (size_t i = 0; i < image.points2D.size(); ++i) {
      const PointId point_id = image.points2D[i].point_id;
      if (!point_id.valid()) continue;
      std::vector<double> of_arms;
      for (const Arm& arm : arms) {
        const auto error = ErrorInArm(arm.model, image_id, i, point_id);
        if (error) of_arms.push_back(*error);
      }
      if (of_arms.size() != arms.size()) continue;
      for (size_t k = 0; k < arms.size(); ++k) errors[k].push_back(of_arms[k]);
    }
  }
  return errors;
}

std::vector<PlaneDistances> MeasurePlaneDistances(const std::vector<Arm>& arms,
                                                  const SemanticMap& semantics) {
  constexpr size_t kMinPoints = 4;  // Three are always on a plane.
  std::vector<PlaneDistances> measured;
  for (const auto& [id, plane] : semantics.planes) {
    const std::vector<PointId> common = CommonPoints(plane.inliers, arms);
    if (common.size() < kMinPoints) continue;
    PlaneDistances of_plane;
    of_plane.id = id;
    for (const Arm& arm : arms) {
      std::vector<Vector3d> points;
      for (const PointId point : common) points.push_back(arm.model.points.at(point).xyz);
      const PlanarSurface surface = FitSurface(plane, points);
      std::vector<double> distances;
      for (const Vector3d& x : points) {
        distances.push_back(std::abs(surface.plane_in_world.SignedDistance(x)));
      }
      of_plane.fitted.push_back(surface);
      of_plane.fitted.back().rms = RootMeanSquare(distances);
      of_plane.fitted.back().rms_sigma = 0.0;
      of_plane.distances.push_back(std::move(distances));
    }
    measured.push_back(std::move(of_plane));
  }
  return measured;
}

}  // namespace s3lam::report
