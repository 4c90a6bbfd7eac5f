#include "truth_json.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace s3lam::synthetic {
namespace {

using nlohmann::json;

// Metres to a hundredth of a millimetre, directions to 1e-9: more digits would only be noise.
json Rounded(const Eigen::Vector3d& v, double unit) {
  json array = json::array();
  for (int k = 0; k < 3; ++k) array.push_back(std::round(v[k] / unit) * unit);
  return array;
}
json Point(const Eigen::Vector3d& v) { return Rounded(v, 1e-5); }

struct SegmentBox {
  int area = 0;
  cv::Rect box;
};

std::map<uint32_t, SegmentBox> MeasureSegments(const SegmentImage& ids) {
  std::map<uint32_t, SegmentBox> boxes;
  for (Eigen::Index y = 0; y < ids.rows(); ++y) {
    for (Eigen::Index x = 0; x < ids.cols();) {
      Eigen::Index end = x + 1;
      while (end < ids.cols() && ids(y, end) == ids(y, x)) ++end;
      SegmentBox& segment = boxes[ids(y, x)];
      const cv::Rect run(static_cast<int>(x), static_cast<int>(y), static_cast<int>(end - x), 1);
      segment.area += run.width;
      segment.box = segment.box.empty() ? run : segment.box | run;
      x = end;
    }
  }
  return boxes;
}

int ClassIdOf(const Scene& scene, const PanopticSegment& segment) {
  return scene.class_table.classes[static_cast<size_t>(segment.class_index)].id;
}

// Corners of the polygons that lie on the object's plane.
std::vector<Eigen::Vector3d> PlaneCorners(const Scene& scene, const SceneObject& object) {
  std::vector<Eigen::Vector3d> corners;
  for (const Surface& surface : scene.surfaces) {
    if (surface.object != object.id - 1 || surface.shape != SurfaceShape::kPolygon) continue;
    const bool on_plane = std::all_of(
        surface.corners.begin(), surface.corners.end(), [&](const Eigen::Vector3d& corner) {
          return std::abs(object.plane_in_world->SignedDistance(corner)) < object.flatness_m + 1e-9;
        });
    if (on_plane) corners.insert(corners.end(), surface.corners.begin(), surface.corners.end());
  }
  return corners;
}

// Outline of the points' hull within the plane, and its area (m^2).
std::pair<std::vector<Eigen::Vector3d>, double> HullOf(const std::vector<Eigen::Vector3d>& points,
                                                       const Plane& plane) {
  const auto axes = PlaneAxes(plane.normal);
  const Eigen::Vector3d& origin = points.front();
  std::vector<cv::Point2f> flat;
  for (const Eigen::Vector3d& point : points) {
    flat.emplace_back(static_cast<float>(axes.first.dot(point - origin)),
                      static_cast<float>(axes.second.dot(point - origin)));
  }
  std::vector<int> hull;
  cv::convexHull(flat, hull);
  std::vector<Eigen::Vector3d> outline;
  std::vector<cv::Point2f> flat_outline;
  for (const int index : hull) {
    outline.push_back(points[static_cast<size_t>(index)]);
    flat_outline.push_back(flat[static_cast<size_t>(index)]);
  }
  return {outline, cv::contourArea(flat_outline)};
}

}  // namespace

json CategoriesJson(const ClassTable& table) {
  json categories = json::array();
  for (const SemanticClass& c : table.classes) {
    categories.push_back({{"id", c.id},
                          {"name", c.name},
                          {"isthing", c.is_thing ? 1 : 0},
                          {"color", {c.color[0], c.color[1], c.color[2]}}});
  }
  return categories;
}

json AnnotationJson(const Scene& scene, const SyntheticPanoptic& panoptic, int image_id,
                    const std::string& mask_name) {
  const auto boxes = MeasureSegments(panoptic.frame.segment_ids);
  json segments = json::array();
  for (const auto& [id, segment] : panoptic.frame.segments) {
    const SegmentBox& measured = boxes.at(id);
    const cv::Rect& box = measured.box;
    segments.push_back({{"id", id},
                        {"category_id", ClassIdOf(scene, segment)},
                        {"area", measured.area},
                        {"bbox", {box.x, box.y, box.width, box.height}},
                        {"iscrowd", 0},
                        {"score", segment.score}});
  }
  return {{"image_id", image_id}, {"file_name", mask_name}, {"segments_info", std::move(segments)}};
}

json FrameTruthJson(const Scene& scene, const SyntheticPanoptic& panoptic) {
  json frame = json::object();
  for (const auto& [id, truth] : panoptic.truth) {
    json objects = json::object();
    for (const auto& [object, pixels] : truth.object_pixels) {
      objects[std::to_string(object)] = pixels;
    }
    json entry = {{"object", truth.object},
                  {"category_id", ClassIdOf(scene, panoptic.frame.segments.at(id))},
                  {"objects", std::move(objects)}};
    for (const CorruptionNote& note : truth.corruption) {
      entry["corruption"].push_back({{"type", note.type}, {"object", note.object}});
    }
    frame[std::to_string(id)] = std::move(entry);
  }
  return frame;
}

json ObjectsJson(const Scene& scene) {
  json objects = json::array();
  for (const SceneObject& object : scene.objects) {
    json entry = {{"id", object.id},
                  {"name", object.name},
                  {"category_id", object.class_id},
                  {"planar", object.plane_in_world.has_value()}};
    if (object.plane_in_world) {
      const std::vector<Eigen::Vector3d> corners = PlaneCorners(scene, object);
      const auto [outline, area_m2] = HullOf(corners, *object.plane_in_world);
      Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
      for (const Eigen::Vector3d& corner : corners) {
        centroid += corner / static_cast<double>(corners.size());
      }
      json polygon = json::array();
      for (const Eigen::Vector3d& corner : outline) polygon.push_back(Point(corner));
      entry["plane_gt"] = {{"n", Rounded(object.plane_in_world->normal, 1e-9)},
                           {"d", object.plane_in_world->offset},
                           {"max_distance_m", object.flatness_m}};
      entry["plane_reliable"] = true;
      entry["centroid_gt"] = Point(centroid);
      entry["polygon_gt"] = std::move(polygon);
      entry["hull_area_gt_m2"] = area_m2;
    }
    objects.push_back(std::move(entry));
  }
  return {{"note",
           "plane_gt: n . x + d = 0 of the object's main face, metres, in the world of "
           "groundtruth.txt, n towards its free side"},
          {"scene", scene.name},
          {"seed", scene.seed},
          {"objects", std::move(objects)}};
}

}  // namespace s3lam::synthetic
