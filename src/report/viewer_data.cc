#include "s3lam/report/viewer_data.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "s3lam/report/html_text.h"
#include "s3lam/report/overlay.h"
#include "s3lam/report/trust_strip.h"

namespace s3lam::report {
namespace {

using Eigen::Vector3d;
using nlohmann::json;

constexpr int kTopClasses = 3;

json ToJson(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }

void Append(const Vector3d& v, std::vector<float>& values) {
  for (const double x : v) values.push_back(static_cast<float>(x));
}

class Builder {
 public:
  Builder(const RunFolder& run, const CommonFrame& frame, const FrameTrust& trust)
      : run_(run), frame_(frame), trust_(trust) {
    for (const Arm& arm : run.arms) {
      for (const auto& [id, point] : arm.model.points) ids_.push_back(id);
    }
    std::sort(ids_.begin(), ids_.end());
    ids_.erase(std::unique(ids_.begin(), ids_.end()), ids_.end());
    radius_ = Radius();
  }

  ViewerData Build() {
    AddPoints();
    AddLabels();
    json arms = json::array();
    for (size_t k = 0; k < run_.arms.size(); ++k) arms.push_back(AddArm(k));
    data_.meta["arms"] = std::move(arms);
    std::vector<float> truth;
    for (const Vector3d& x : frame_.truth_in_view) Append(x, truth);
    Add("truth", truth);
    data_.has_truth = !truth.empty();
    for (const FrameState state : {FrameState::kGood, FrameState::kWeak, FrameState::kLost}) {
      data_.meta["state_colors"].push_back(StateColor(state));
    }
    data_.meta["points"] = ids_.size();
    data_.meta["radius"] = radius_;
    data_.num_points = ids_.size();
    return std::move(data_);
  }

 private:
  template <typename T>
  void Add(const std::string& name, const std::vector<T>& values) {
    data_.arrays.emplace_back(name, Base64OfArray(std::span<const T>(values)));
  }

  void AddPoints() {
    std::vector<double> ids;
    std::vector<uint8_t> colors;
    for (const PointId id : ids_) {
      ids.push_back(static_cast<double>(id.value()));
      // "model_by_class" has no colours of its own; refinement keeps the image's.
      for (size_t k = run_.arms.size(); k-- > 0;) {
        const auto point = run_.arms[k].model.points.find(id);
        if (point == run_.arms[k].model.points.end()) continue;
        colors.insert(colors.end(), point->second.color.begin(), point->second.color.end());
        break;
      }
    }
    Add("id", ids);
    Add("color", colors);
  }

  /// Classes, clusters, planes, and per point its cluster and its distribution.
  void AddLabels() {
    std::vector<int32_t> cluster(ids_.size(), -1);
    std::vector<uint16_t> top_class(kTopClasses * ids_.size(), 0);
    std::vector<uint8_t> top_share(kTopClasses * ids_.size(), 0);
    data_.meta["classes"] = json::array();
    data_.meta["clusters"] = json::array();
    data_.meta["planes"] = json::array();
    if (run_.semantics) {
      const SemanticMap& map = *run_.semantics;
      AddTables(map);
      const RowOfPoint rows = RowsOfPoints(map);
      for (size_t i = 0; i < ids_.size(); ++i) {
        const auto row = rows.find(ids_[i]);
        if (row == rows.end()) continue;
        const auto found = cluster_index_.find(map.cluster_of_point[row->second]);
        if (found != cluster_index_.end()) cluster[i] = found->second;
        AddDistribution(map, row->second, &top_class[kTopClasses * i], &top_share[kTopClasses * i]);
      }
    }
    Add("cluster", cluster);
    Add("top-class", top_class);
    Add("top-share", top_share);
  }

  void AddTables(const SemanticMap& map) {
    std::vector<size_t> points_of_class(map.class_table.classes.size(), 0);
    for (const auto& [id, cluster] : map.clusters) {
      cluster_index_[id] = static_cast<int32_t>(cluster_index_.size());
      points_of_class.at(static_cast<size_t>(cluster.class_index)) += cluster.points.size();
      data_.meta["clusters"].push_back(
          {{"id", id.value()}, {"class", cluster.class_index}, {"points", cluster.points.size()}});
    }
    for (const auto& [id, plane] : AllPlanes(run_)) {
      plane_index_[id] = static_cast<int32_t>(plane_index_.size());
      data_.meta["planes"].push_back({{"id", id.value()},
                                      {"class", plane.class_index},
                                      {"cluster", cluster_index_.at(plane.cluster_id)},
                                      {"points", plane.inliers.size()}});
    }
    for (size_t i = 0; i < points_of_class.size(); ++i) {
      const SemanticClass& c = map.class_table.classes[i];
      data_.meta["classes"].push_back(
          {{"name", ValidUtf8(c.name)}, {"color", c.color}, {"points", points_of_class[i]}});
    }
  }

  /// The likeliest classes with their probability, in 255ths.
  static void AddDistribution(const SemanticMap& map, size_t row, uint16_t* classes,
                              uint8_t* shares) {
    const auto distribution = map.distributions.row(static_cast<Eigen::Index>(row));
    std::vector<int> order(static_cast<size_t>(distribution.cols()));
    for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
    const auto count = std::min<size_t>(kTopClasses, order.size());
    std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count),
                      order.end(), [&](int a, int b) {
                        return std::pair(-distribution[a], a) < std::pair(-distribution[b], b);
                      });
    for (size_t k = 0; k < count; ++k) {
      const double share = std::clamp(double(distribution[order[k]]), 0.0, 1.0);
      classes[k] = static_cast<uint16_t>(order[k]);
      shares[k] = static_cast<uint8_t>(std::lround(255.0 * share));
    }
  }

  json AddArm(size_t k) {
    const Arm& arm = run_.arms[k];
    const Similarity3& view_from_arm = frame_.view_from_arm[k];
    std::vector<float> positions;
    positions.reserve(3 * ids_.size());
    for (const PointId id : ids_) {
      const auto point = arm.model.points.find(id);
      Append(point == arm.model.points.end()
                 ? Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()).eval()
                 : view_from_arm * point->second.xyz,
             positions);
    }
    Add(fmt::format("position-{}", k), positions);
    Add(fmt::format("cameras-{}", k), CameraShapes(arm, view_from_arm));
    std::vector<float> path;
    for (const TimedPose& pose : arm.trajectory) {
      Append(view_from_arm * pose.world_from_camera.translation, path);
    }
    Add(fmt::format("path-{}", k), path);
    json planes = json::array();
    for (const PlanarSurface& plane : arm.planes) planes.push_back(PlaneJson(plane, view_from_arm));
    AddMembers(k);
    return {{"title", arm.title}, {"planes", std::move(planes)}, {"trust", AddTrust(k)}};
  }

  /// The state of every pose of the path: true if it is known.
  bool AddTrust(size_t k) {
    std::vector<uint8_t> states;
    for (const FrameState state : StatesOfTrajectory(trust_, run_.arms[k])) {
      states.push_back(static_cast<uint8_t>(state));
    }
    if (states.empty()) return false;
    Add(fmt::format("trust-{}", k), states);
    data_.has_trust = true;
    return true;
  }

  /// The plane each point is on in one arm, or -1.
  void AddMembers(size_t k) {
    std::vector<int32_t> plane_of_point(ids_.size(), -1);
    for (const PlanarSurface& plane : run_.arms[k].planes) {
      for (const PointId point : plane.inliers) {
        const auto at = std::lower_bound(ids_.begin(), ids_.end(), point);
        if (at == ids_.end() || *at != point) continue;
        plane_of_point[static_cast<size_t>(at - ids_.begin())] = plane_index_.at(plane.id);
      }
    }
    Add(fmt::format("plane-{}", k), plane_of_point);
  }

  /// Centre and image corners of every camera, a small distance before it.
  std::vector<float> CameraShapes(const Arm& arm, const Similarity3& view_from_arm) const {
    const double depth = 0.04 * radius_ / view_from_arm.scale;
    std::vector<float> shapes;
    for (const auto& [id, image] : arm.model.images) {
      const Camera& camera = arm.model.CameraOf(image);
      const Rigid3 world_from_cam = image.cam_from_world.Inverse();
      Append(view_from_arm * world_from_cam.translation, shapes);
      for (const auto& [x, y] :
           {std::pair(0, 0), std::pair(1, 0), std::pair(1, 1), std::pair(0, 1)}) {
        const Eigen::Vector2d corner(x * double(camera.width), y * double(camera.height));
        // A corner that the distortion does not reach is put on the axis.
        const Eigen::Vector2d ray = camera.CameraFromImage(corner).value_or(Eigen::Vector2d(0, 0));
        Append(view_from_arm * (world_from_cam * (depth * ray.homogeneous())), shapes);
      }
    }
    return shapes;
  }

  [[nodiscard]] json PlaneJson(const PlanarSurface& plane, const Similarity3& view_from_arm) const {
    json outline = json::array();
    for (const Eigen::Vector2d& uv : plane.extent) {
      outline.push_back(
          ToJson(view_from_arm * (plane.centroid_in_world + uv.x() * plane.axis_u_in_world +
                                  uv.y() * plane.axis_v_in_world)));
    }
    const auto& c = run_.semantics->class_table.classes.at(static_cast<size_t>(plane.class_index));
    return {{"index", plane_index_.at(plane.id)},
            {"color", c.color},
            {"points", plane.inliers.size()},
            {"outline", std::move(outline)},
            {"centroid", ToJson(view_from_arm * plane.centroid_in_world)},
            {"normal", ToJson(view_from_arm.rotation * plane.plane_in_world.normal)},
            {"normal_in_world", ToJson(plane.plane_in_world.normal)},
            {"rms", plane.rms},
            {"rms_sigma", plane.rms_sigma}};
  }

  /// Of a ball about the origin that holds nine tenths of the last arm's points.
  [[nodiscard]] double Radius() const {
    std::vector<double> distances;
    for (const auto& [id, point] : run_.arms.back().model.points) {
      distances.push_back((frame_.view_from_arm.back() * point.xyz).norm());
    }
    if (distances.empty()) return 1.0;
    std::sort(distances.begin(), distances.end());
    const double radius = distances[(distances.size() - 1) * 9 / 10];
    return radius > 0.0 ? radius : 1.0;
  }

  const RunFolder& run_;
  const CommonFrame& frame_;
  const FrameTrust& trust_;
  std::vector<PointId> ids_;
  double radius_ = 1.0;
  std::map<ClusterId, int32_t> cluster_index_;
  std::map<PlaneId, int32_t> plane_index_;
  ViewerData data_;
};

}  // namespace

ViewerData MakeViewerData(const RunFolder& run, const CommonFrame& frame, const FrameTrust& trust) {
  return Builder(run, frame, trust).Build();
}

}  // namespace s3lam::report
