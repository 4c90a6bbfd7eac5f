#pragma once

#include <opencv2/imgcodecs.hpp>

#include "s3lam/io/colmap_model.h"
#include "s3lam/io/file.h"
#include "s3lam/io/semantic_map_io.h"
#include "s3lam/io/trajectory.h"
#include "s3lam/report/pipeline.h"
#include "s3lam/synthetic/synthetic_map.h"
#include "support/temp_dir.h"

namespace s3lam::testing {

/// A map of a small synthetic scene, in error and true: what is before and after.
inline const SyntheticMap& SmallMap() {
  static const SyntheticMap map = [] {
    SyntheticMapOptions options;
    options.num_images = 8;
    options.num_points = 400;
    options.point_sigma = 0.01;
    options.center_sigma = 0.01;
    return MakeSyntheticMap("desk", 1, options);
  }();
  return map;
}

/// One pose a second.
inline Trajectory TrajectoryOf(const Reconstruction& model) {
  Trajectory trajectory;
  for (const auto& [id, image] : model.images) {
    trajectory.push_back({double(trajectory.size()), image.cam_from_world.Inverse()});
  }
  return trajectory;
}

/// planes.json of the semantic map's planes.
inline nlohmann::json PlanesJson(const SemanticMap& map) {
  nlohmann::json planes = nlohmann::json::array();
  const auto list = [](const auto& v) {
    return std::vector<double>(v.data(), v.data() + v.size());
  };
  for (const auto& [id, plane] : map.planes) {
    nlohmann::json inliers = nlohmann::json::array();
    for (const PointId point : plane.inliers) inliers.push_back(point.value());
    planes.push_back({{"id", id.value()},
                      {"cluster_id", plane.cluster_id.value()},
                      {"normal_in_world", list(plane.plane_in_world.normal)},
                      {"offset", plane.plane_in_world.offset},
                      {"inliers", std::move(inliers)},
                      {"centroid_in_world", list(plane.centroid_in_world)},
                      {"axis_u_in_world", list(plane.axis_u_in_world)},
                      {"axis_v_in_world", list(plane.axis_v_in_world)},
                      {"extent_uv", {{-0.1, -0.1}, {0.1, -0.1}, {0.0, 0.1}}},
                      {"rms", plane.rms},
                      {"rms_sigma", plane.rms_sigma}});
  }
  return {{"planes", std::move(planes)}};
}

/// A folder as tools/run.sh makes it, without images.
class RunOnDisk {
 public:
  RunOnDisk() {
    const SyntheticMap& map = SmallMap();
    WriteModel("1_slam", map.estimate);
    WriteModel("3_refine_plain", map.estimate);
    WriteModel("3_refine", map.truth);
    std::filesystem::create_directories(path() / "2_lift");
    WriteSemanticMap(map.semantics, path() / "2_lift");
    WriteJson(path() / "3_refine" / "planes.json", PlanesJson(map.semantics));
    WriteTumTrajectory(TrajectoryOf(map.truth), truth());
  }

  void WriteModel(const char* folder, const Reconstruction& model) const {
    std::filesystem::create_directories(path() / folder);
    WriteColmapModel(model, path() / folder);
    WriteTumTrajectory(TrajectoryOf(model), path() / folder / "keyframes.txt");
    WriteJson(path() / folder / "report.json", {{"seconds", {{"everything", 1.25}}}});
    WriteJson(path() / folder / "config.json", {{"some", {{"option", 5}}}});
  }

  /// A plain grey image for every image of the model.
  std::filesystem::path WriteImages() const {
    const std::filesystem::path images = directory_ / "images";
    for (const auto& [id, image] : SmallMap().truth.images) {
      const Camera& camera = SmallMap().truth.CameraOf(image);
      std::filesystem::create_directories((images / image.name).parent_path());
      cv::imwrite((images / image.name).string(),
                  cv::Mat(int(camera.height), int(camera.width), CV_8UC3, cv::Scalar::all(90)));
    }
    return images;
  }

  [[nodiscard]] std::filesystem::path path() const { return directory_ / "run"; }
  [[nodiscard]] std::filesystem::path truth() const { return directory_ / "truth.txt"; }

 private:
  TempDir directory_;
};

}  // namespace s3lam::testing
