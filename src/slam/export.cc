#include "s3lam/slam/export.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "s3lam/base/error.h"
#include "s3lam/base/statistics.h"

namespace s3lam::slam {
namespace {

ImageId ImageOfFrame(int frame) { return ImageId(static_cast<uint32_t>(frame) + 1); }

/// Images with all their keypoints, at the pixels where they were found or corrected to.
void AddImages(const Input& input, Camera camera, const Map& map, const std::vector<int>& keyframes,
               Model& model) {
  Reconstruction& reconstruction = model.reconstruction;
  camera.id = CameraId(1);
  reconstruction.cameras[camera.id] = camera;
  for (const int k : keyframes) {
    const int frame = map.keyframe(k).frame;
    Image image;
    image.id = ImageOfFrame(frame);
    image.camera_id = camera.id;
    image.name = input.names[frame];
    image.cam_from_world = map.keyframe(k).cam_from_world;
    const FrameFeatures& features = map.features(k);
    image.points2D.resize(static_cast<size_t>(features.size()));
    std::vector<float>& sigmas = model.keypoint_sigmas[image.id];
    for (int i = 0; i < features.size(); ++i) {
      image.points2D[i].xy = features.keypoint(i).pixel.cast<double>();
      sigmas.push_back(features.keypoint(i).sigma);
    }
    reconstruction.images.emplace(image.id, std::move(image));
  }
}

/// Ids of the exported points, by their index in the map.
std::vector<PointId> AddPoints(const Map& map, Model& model) {
  std::vector<PointId> ids(static_cast<size_t>(map.num_points()), kInvalidPointId);
  uint64_t next_id = 1;
  for (int p = 0; p < map.num_points(); ++p) {
    const MapPoint& point = map.point(p);
    if (!point.alive) continue;
    const PointId id(next_id++);
    ids[p] = id;
    ScenePoint scene_point;
    scene_point.xyz = point.position;
    for (const MapObservation& o : point.observations) {
      const ImageId image = ImageOfFrame(map.keyframe(o.keyframe).frame);
      scene_point.track.push_back({image, static_cast<uint32_t>(o.keypoint)});
      model.reconstruction.images.at(image).points2D[o.keypoint].point_id = id;
    }
    std::sort(scene_point.track.begin(), scene_point.track.end());
    model.reconstruction.points.emplace(id, std::move(scene_point));
    model.descriptors.emplace(id, point.descriptor);
  }
  return ids;
}

void AddFrameObservations(const Input& input, const Map& map,
                          const std::vector<FrameTrack>& localized,
                          const std::vector<PointId>& point_ids, Model& model) {
  for (size_t i = 0; i < localized.size(); ++i) {
    const int index = static_cast<int>(i);
    if (!localized[i].tracked || model.reconstruction.images.contains(ImageOfFrame(index))) {
      continue;
    }
    ObservedFrame frame;
    frame.time_s = input.times_s[i];
    frame.camera_id = model.reconstruction.cameras.begin()->first;
    for (const PointMatch& match : localized[i].matches) {
      const PointId id = point_ids[match.point];
      const Keypoint& keypoint = map.frame(index).keypoint(match.keypoint);
      if (id.valid()) frame.observations.push_back({id, keypoint.pixel, keypoint.sigma});
    }
    model.observations.push_back(std::move(frame));
  }
}

/// Mean colour of each point over the keyframes that see it.
void AddColors(const Input& input, Reconstruction& reconstruction) {
  std::map<PointId, std::array<double, 3>> sums;
  for (const auto& [id, image] : reconstruction.images) {
    const cv::Mat picture = input.read_color(id.value() - 1);
    for (const Point2D& point2D : image.points2D) {
      if (!point2D.point_id.valid()) continue;
      const int x = std::clamp(static_cast<int>(point2D.xy.x()), 0, picture.cols - 1);
      const int y = std::clamp(static_cast<int>(point2D.xy.y()), 0, picture.rows - 1);
      std::array<double, 3>& sum = sums[point2D.point_id];
      if (picture.channels() == 3) {
        const cv::Vec3b bgr = picture.at<cv::Vec3b>(y, x);
        for (int c = 0; c < 3; ++c) sum[static_cast<size_t>(c)] += bgr[2 - c];
      } else {
        for (double& channel : sum) channel += picture.at<uint8_t>(y, x);
      }
    }
  }
  for (auto& [id, point] : reconstruction.points) {
    for (size_t c = 0; c < 3; ++c) {
      point.color[c] =
          static_cast<uint8_t>(std::lround(sums[id][c] / static_cast<double>(point.track.size())));
    }
  }
}

void AddTrajectories(const Input& input, const std::vector<FrameTrack>& localized, Model& model) {
  for (size_t i = 0; i < localized.size(); ++i) {
    if (!localized[i].tracked) continue;
    const TimedPose pose{input.times_s[i], localized[i].cam_from_world.Inverse()};
    model.frames.push_back(pose);
    if (model.reconstruction.images.contains(ImageOfFrame(static_cast<int>(i)))) {
      model.keyframes.push_back(pose);
    }
  }
}

}  // namespace

Model Export(const Input& input, const Camera& camera, const Map& map,
             const std::vector<FrameTrack>& localized) {
  Model model;
  AddImages(input, camera, map, map.KeyframesInTime(), model);
  const std::vector<PointId> point_ids = AddPoints(map, model);
  AddFrameObservations(input, map, localized, point_ids, model);
  AddColors(input, model.reconstruction);
  UpdatePointErrors(model.reconstruction);
  AddTrajectories(input, localized, model);
  return model;
}

MapReport DescribeMap(const Model& model, const MapBuilder& builder,
                      const std::vector<FrameTrack>& localized) {
  MapReport report;
  report.num_frames = static_cast<int>(model.frames.size());
  report.num_keyframes = static_cast<int>(model.reconstruction.images.size());
  report.num_points = static_cast<int>(model.reconstruction.points.size());
  report.num_observations = static_cast<int>(model.reconstruction.NumObservations());
  if (report.num_points > 0) {
    report.mean_track_length =
        static_cast<double>(report.num_observations) / static_cast<double>(report.num_points);
  }
  report.rms_px = ComputeReprojectionStatistics(model.reconstruction).rms_px;
  report.aligned_sigmas_px = builder.map().aligned_sigmas();
  for (int i = 0; i < static_cast<int>(localized.size()); ++i) {
    if (!localized[i].tracked) continue;
    if (report.first_frame < 0) report.first_frame = i;
    report.last_frame = i;
  }
  report.num_relocalizations = builder.num_relocalizations();
  report.initial_frames = {builder.initial_pair().frame_a, builder.initial_pair().frame_b};
  report.initial_parallax_deg = builder.initial_pair().parallax_deg;
  report.initial_error = builder.initial_pair().mean_squared_error;
  report.initial_rotation_only_error = builder.initial_pair().rotation_only_error;
  report.initial_other_motions = builder.initial_pair().num_other_motions;
  report.initial_other_error = builder.initial_pair().other_error;
  return report;
}

double MedianDepth(const Map& map, const FrameTrack& track) {
  std::vector<double> depths;
  for (const PointMatch& match : track.matches) {
    depths.push_back((track.cam_from_world * map.point(match.point).position).z());
  }
  return Median(std::move(depths));
}

FrameReport DescribeFrame(const Undistorter& undistorter, const Map& map, int frame,
                          const FrameTrack& track) {
  constexpr int kCells = 4;  // Along each side of the image.
  FrameReport report;
  report.num_inliers = static_cast<int>(track.matches.size());
  std::array<bool, kCells * kCells> covered{};
  double squared = 0.0;
  for (const PointMatch& match : track.matches) {
    const Keypoint& keypoint = map.frame(frame).keypoint(match.keypoint);
    const Eigen::Vector2d xy = keypoint.undistorted.cast<double>();
    squared += SquaredError(undistorter.intrinsics(), track.cam_from_world,
                            map.point(match.point).position, xy, 1.0 / keypoint.sigma);
    covered[undistorter.CellOf(keypoint, kCells, kCells)] = true;
  }
  report.spread = static_cast<double>(std::count(covered.begin(), covered.end(), true)) /
                  static_cast<double>(covered.size());
  // Two measurements a point.
  if (!track.matches.empty()) report.rms_sigma = std::sqrt(squared / (2.0 * report.num_inliers));
  return report;
}

}  // namespace s3lam::slam
