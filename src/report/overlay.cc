#include "s3lam/report/overlay.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <unordered_set>

namespace s3lam {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kSubpixelBits = 4;
const cv::Scalar kGrey(150, 150, 150);

cv::Scalar ToScalar(const Rgb& color) {
  return {double(color[2]), double(color[1]), double(color[0])};
}

/// Pixel centres are at 0.5 in the model and at 0 in OpenCV's drawing.
cv::Point ToFixed(const Vector2d& xy, double scale) {
  const Vector2d p =
      ((xy * scale).array() - 0.5).cwiseMax(-1e4).cwiseMin(1e5) * (1 << kSubpixelBits);
  return {static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y()))};
}

const Rgb& ColorOfClass(const SemanticMap& map, int class_index) {
  return map.class_table.classes.at(static_cast<size_t>(class_index)).color;
}

/// Colours stand out on any image by a dark rim.
void DrawLine(const std::vector<cv::Point>& points, bool closed, const cv::Scalar& color,
              int thickness, cv::Mat& picture) {
  cv::polylines(picture, points, closed, cv::Scalar::all(0), thickness + 2, cv::LINE_AA,
                kSubpixelBits);
  cv::polylines(picture, points, closed, color, thickness, cv::LINE_AA, kSubpixelBits);
}

/// Where a keypoint's cluster puts it; empty for a point in none.
std::optional<int> ClassOfPoint(const SemanticMap& map, const RowOfPoint& rows, PointId id) {
  const auto row = rows.find(id);
  if (row == rows.end()) return std::nullopt;
  const auto cluster = map.clusters.find(map.cluster_of_point[row->second]);
  if (cluster == map.clusters.end()) return std::nullopt;
  return cluster->second.class_index;
}

void DrawKeypoints(const Image& image, const SemanticMap& map, const RowOfPoint& rows,
                   const OverlayOptions& options, cv::Mat& picture) {
  for (const Point2D& keypoint : image.points2D) {
    if (!keypoint.point_id.valid()) continue;
    const std::optional<int> class_index = ClassOfPoint(map, rows, keypoint.point_id);
    const cv::Scalar color = class_index ? ToScalar(ColorOfClass(map, *class_index)) : kGrey;
    const double radius = (class_index ? 1.0 : 0.6) * options.keypoint_radius;
    const auto fixed = [](double px) {
      return static_cast<int>(std::lround(px * (1 << kSubpixelBits)));
    };
    const cv::Point at = ToFixed(keypoint.xy, options.scale);
    cv::circle(picture, at, fixed(radius + 1.0), cv::Scalar::all(0), cv::FILLED, cv::LINE_AA,
               kSubpixelBits);
    cv::circle(picture, at, fixed(radius), color, cv::FILLED, cv::LINE_AA, kSubpixelBits);
  }
}

/// The pixel of a point, if it is in the picture or not too far from it: near the image plane
/// pixels run off to infinity, and far from the axis a distortion folds back into the picture,
/// which going back from the pixel to the ray shows.
std::optional<Vector2d> ProjectNear(const Camera& camera, const Vector3d& point_in_camera) {
  auto xy = camera.ImageFromCamera(point_in_camera);
  if (!xy) return std::nullopt;
  const Vector2d size(static_cast<double>(camera.width), static_cast<double>(camera.height));
  if (!((xy->cwiseQuotient(size).array() - 0.5).abs().maxCoeff() < 4.0)) return std::nullopt;
  const Vector2d ray = point_in_camera.hnormalized();
  const auto back = camera.CameraFromImage(*xy);
  if (!back || !((*back - ray).norm() < 1e-3 * (1.0 + ray.norm()))) return std::nullopt;
  return xy;
}

/// The outline in the picture: its edges in short pieces, since a distorted line is bent; broken
/// where the camera cannot see it.
void DrawOutline(const Camera& camera, const Rigid3& cam_from_world, const PlanarSurface& plane,
                 const cv::Scalar& color, double scale, cv::Mat& picture) {
  constexpr int kPieces = 48;
  std::vector<cv::Point> line;
  const auto flush = [&] {
    if (line.size() > 1) DrawLine(line, false, color, 1, picture);
    line.clear();
  };
  const size_t count = plane.extent.size();
  for (size_t i = 0; i < count; ++i) {
    for (int k = 0; k <= kPieces; ++k) {
      const double part = double(k) / kPieces;
      const Vector2d uv = (1.0 - part) * plane.extent[i] + part * plane.extent[(i + 1) % count];
      const Vector3d in_world =
          plane.centroid_in_world + uv.x() * plane.axis_u_in_world + uv.y() * plane.axis_v_in_world;
      const auto xy = ProjectNear(camera, cam_from_world * in_world);
      if (xy) {
        line.push_back(ToFixed(*xy, scale));
      } else {
        flush();
      }
    }
  }
  flush();
}

/// The normal as an arrow, the axes in the plane as thin lines.
void DrawNormal(const Camera& camera, const Rigid3& cam_from_world, const PlanarSurface& plane,
                const Vector3d& foot_in_world, const cv::Scalar& color,
                const OverlayOptions& options, cv::Mat& picture) {
  const double distance = (cam_from_world * foot_in_world).norm();
  const Vector3d tip_in_world =
      foot_in_world + options.arrow_length * distance * plane.plane_in_world.normal;
  const auto foot = ProjectNear(camera, cam_from_world * foot_in_world);
  const auto tip = ProjectNear(camera, cam_from_world * tip_in_world);
  if (!foot || !tip) return;
  for (const Vector3d& axis : {plane.axis_u_in_world, plane.axis_v_in_world}) {
    const auto end = ProjectNear(
        camera, cam_from_world * (foot_in_world + options.axis_length * distance * axis));
    if (end) {
      DrawLine({ToFixed(*foot, options.scale), ToFixed(*end, options.scale)}, false, color, 1,
               picture);
    }
  }
  DrawLine({ToFixed(*foot, options.scale), ToFixed(*tip, options.scale)}, false, color, 2, picture);
  const Vector2d arm = *tip - *foot;
  if (arm.norm() * options.scale < 4.0) return;  // Seen end on: no room for a head.
  const Vector2d back = -0.3 * arm;
  const Vector2d side(-back.y(), back.x());
  DrawLine({ToFixed(*tip + back + 0.5 * side, options.scale), ToFixed(*tip, options.scale),
            ToFixed(*tip + back - 0.5 * side, options.scale)},
           false, color, 2, picture);
}

}  // namespace

RowOfPoint RowsOfPoints(const SemanticMap& map) {
  RowOfPoint rows;
  rows.reserve(map.points.size());
  for (size_t i = 0; i < map.points.size(); ++i) rows.emplace(map.points[i], i);
  return rows;
}

void DrawOverlay(const Camera& camera, const Image& image, const SemanticMap& map,
                 const RowOfPoint& rows, std::span<const PlanarSurface> planes,
                 const Reconstruction& model, const OverlayOptions& options, cv::Mat& picture) {
  DrawKeypoints(image, map, rows, options, picture);
  std::unordered_set<PointId> observed;
  for (const Point2D& keypoint : image.points2D) {
    if (keypoint.point_id.valid()) observed.insert(keypoint.point_id);
  }
  for (const PlanarSurface& plane : planes) {
    Vector3d sum = Vector3d::Zero();
    int count = 0;
    for (const PointId id : plane.inliers) {
      const auto point = observed.contains(id) ? model.points.find(id) : model.points.end();
      if (point == model.points.end()) continue;
      sum += point->second.xyz;
      ++count;
    }
    if (count < std::max(1, options.min_plane_observations)) continue;
    const cv::Scalar color = ToScalar(ColorOfClass(map, plane.class_index));
    DrawOutline(camera, image.cam_from_world, plane, color, options.scale, picture);
    DrawNormal(camera, image.cam_from_world, plane, plane.plane_in_world.Project(sum / count),
               color, options, picture);
  }
}

}  // namespace s3lam
