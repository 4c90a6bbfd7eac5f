#include "s3lam/slam/rolling_shutter.h"

#include <Eigen/Cholesky>
#include <array>
#include <cmath>

#include "s3lam/base/statistics.h"
#include "s3lam/slam/export.h"
#include "s3lam/slam/focal_search.h"

namespace s3lam {
namespace {

constexpr std::array<std::string_view, 3> kModeNames{"off", "check", "compensate"};
constexpr std::array<std::string_view, 4> kDirectionNames{"down", "up", "right", "left"};
constexpr double kBridgedIntervals = 3.0;
constexpr size_t kReach = 2;              // Frames on either side that tell a motion.
constexpr double kMaxSquaredError = 9.0;  // [sigma^2]
constexpr int kMinObservations = 20;      // Of a keyframe.
constexpr size_t kMinKeyframes = 8;       // Fewer are explained by chance.
constexpr double kStepS = 1e-3;           // Of numerical derivatives.

/// Of a pixel from the middle of the image, in widths and heights of it.
Eigen::Vector2d FromMiddle(const Camera& camera, const Eigen::Vector2f& pixel) {
  const Eigen::Vector2d size(camera.width, camera.height);
  return pixel.cast<double>().cwiseQuotient(size).array() - 0.5;
}

/// Per unknown of a keyframe's least squares (omega and tau of the pose, readout times along x and
/// y) and of the residual: its products with all others, the pose eliminated.
using Products = Eigen::Matrix3d;

/// Empty where a keyframe sees too little.
std::optional<Products> ProductsOf(const Undistorter& undistorter, const Map& map, int keyframe,
                                   const FrameMotion& motion) {
  const PinholeIntrinsics& intrinsics = undistorter.intrinsics();
  const Rigid3& cam_from_world = map.keyframe(keyframe).cam_from_world;
  Eigen::Matrix<double, 9, 9> sum = Eigen::Matrix<double, 9, 9>::Zero();
  int count = 0;
  for (const PointMatch& match : map.MatchesOf(keyframe)) {
    const Keypoint& keypoint = map.features(keyframe).keypoint(match.keypoint);
    const Eigen::Vector3d& point = map.point(match.point).position;
    const Eigen::Vector3d x = cam_from_world * point;
    if (x.z() <= 0.0) continue;
    const Eigen::Vector2d residual = keypoint.undistorted.cast<double>() - intrinsics.Project(x);
    if (residual.squaredNorm() > kMaxSquaredError * keypoint.sigma * keypoint.sigma) continue;
    const Eigen::Matrix<double, 2, 3> projection = intrinsics.ProjectionJacobian(x);
    const Eigen::Vector2d place = FromMiddle(undistorter.camera(), keypoint.pixel);
    const Eigen::Vector2d velocity = projection * motion.VelocityOf(point);
    Eigen::Matrix<double, 2, 9> row;
    row << -projection * CrossMatrix(x), projection, place.x() * velocity, place.y() * velocity,
        residual;
    row /= keypoint.sigma;
    sum += row.transpose() * row;
    ++count;
  }
  if (count < kMinObservations) return std::nullopt;
  const Eigen::Matrix<double, 6, 3> mixed = sum.topRightCorner<6, 3>();
  return Products(sum.bottomRightCorner<3, 3>() -
                  mixed.transpose() * sum.topLeftCorner<6, 6>().ldlt().solve(mixed));
}

/// Of the readout time along one axis that fits all keyframes best.
double CostShare(const std::vector<Products>& keyframes, int axis) {
  double squared = 0.0;
  double mixed = 0.0;
  double cost = 0.0;
  for (const Products& products : keyframes) {
    squared += products(axis, axis);
    mixed += products(axis, 2);
    cost += products(2, 2);
  }
  const bool is_enough = keyframes.size() >= kMinKeyframes && squared > 0.0 && cost > 0.0;
  return is_enough ? mixed * mixed / (squared * cost) : 0.0;
}

}  // namespace

void RollingShutterOptions::Visit(OptionVisitor& v) {
  v.Choice("mode", mode, kModeNames,
           "what is done about the lines of an image being exposed one after another: nothing; the "
           "run says whether that is seen; keypoints are moved to where they would be if all were "
           "exposed as the middle one is");
  v.Value("readout_s", readout_s,
          "with mode compensate: from the exposure of the first line to that of the last, if it is "
          "known, at most the time from image to image; 0: estimated, with the direction [s]",
          0.0, 1.0);
  v.Choice("direction", direction, kDirectionNames,
           "with readout_s: where the lines follow one another to, in the images as they are read");
}

std::string_view ShutterDirectionName(ShutterDirection direction) {
  return kDirectionNames.at(static_cast<size_t>(direction));
}

Readout MakeReadout(double readout_s, ShutterDirection direction) {
  switch (direction) {
    case ShutterDirection::kUp:
      return {0.0, -readout_s};
    case ShutterDirection::kRight:
      return {readout_s, 0.0};
    case ShutterDirection::kLeft:
      return {-readout_s, 0.0};
    default:
      return {0.0, readout_s};
  }
}

ShutterDirection DirectionOf(const Readout& readout) {
  if (std::abs(readout.x()) > std::abs(readout.y())) {
    return readout.x() > 0.0 ? ShutterDirection::kRight : ShutterDirection::kLeft;
  }
  return readout.y() >= 0.0 ? ShutterDirection::kDown : ShutterDirection::kUp;
}

Eigen::Vector3d FrameMotion::VelocityOf(const Eigen::Vector3d& point_in_world) const {
  return (PointAfter(kStepS, point_in_world) - PointAfter(-kStepS, point_in_world)) /
         (2.0 * kStepS);
}

Eigen::Vector3d FrameMotion::PointAfter(double time_s,
                                        const Eigen::Vector3d& point_in_world) const {
  // Lagrange's polynomials.
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  for (size_t j = 0; j < poses_.size(); ++j) {
    double weight = 1.0;
    for (size_t m = 0; m < poses_.size(); ++m) {
      if (m == j) continue;
      weight *= (time_s - poses_[m].time_s) / (poses_[j].time_s - poses_[m].time_s);
    }
    point += weight * (poses_[j].cam_from_world * point_in_world);
  }
  return point;
}

std::vector<std::optional<FrameMotion>> FindMotions(const std::vector<double>& times_s,
                                                    const std::vector<FrameTrack>& localized) {
  const double max_interval_s = kBridgedIntervals * MedianStep(times_s);
  const auto is_bridged = [&](size_t i) {  // From frame i - 1 to frame i.
    return i > 0 && i < localized.size() && localized[i - 1].tracked && localized[i].tracked &&
           times_s[i] - times_s[i - 1] <= max_interval_s;
  };
  std::vector<std::optional<FrameMotion>> motions(localized.size());
  for (size_t i = 0; i < localized.size(); ++i) {
    size_t first = i;
    size_t last = i;
    while (i - first < kReach && is_bridged(first)) --first;
    while (last - i < kReach && is_bridged(last + 1)) ++last;
    if (first == last) continue;
    std::vector<FrameMotion::Pose> poses;
    for (size_t k = first; k <= last; ++k) {
      poses.push_back({times_s[k] - times_s[i], localized[k].cam_from_world});
    }
    motions[i] = FrameMotion(std::move(poses));
  }
  return motions;
}

ReadoutShares FindReadoutShares(const Undistorter& undistorter,
                                const std::vector<MapInMotion>& maps) {
  std::vector<Products> keyframes;
  for (const auto& [map, motions] : maps) {
    for (const int k : map.AliveKeyframes()) {
      const auto& motion = motions[map.keyframe(k).frame];
      if (!motion) continue;
      if (const auto products = ProductsOf(undistorter, map, k, *motion)) {
        keyframes.push_back(*products);
      }
    }
  }
  return {CostShare(keyframes, 0), CostShare(keyframes, 1)};
}

CalibrationProblem MakeReadoutProblem(const Undistorter& undistorter,
                                      const MapInMotion& map_in_motion,
                                      const Eigen::Vector2d& axis) {
  const Map& map = map_in_motion.map;
  const Camera& camera = undistorter.camera();
  return MakeCalibrationProblem(map, [&](const MapObservation& o, const MapPoint& point) {
    const auto& motion = map_in_motion.motions[map.keyframe(o.keyframe).frame];
    Eigen::Vector2d per_readout = Eigen::Vector2d::Zero();
    if (!motion) return per_readout;
    const auto before = camera.ImageFromCamera(motion->PointAfter(-kStepS, point.position));
    const auto after = camera.ImageFromCamera(motion->PointAfter(kStepS, point.position));
    if (!before || !after) return per_readout;
    const double share = axis.dot(FromMiddle(camera, map.keypoint(o).pixel));
    per_readout = share * (*after - *before) / (2.0 * kStepS);
    return per_readout;
  });
}

ShutterCorrection::ShutterCorrection(const Map& map, size_t num_frames) : places_(num_frames) {
  for (size_t i = 0; i < num_frames; ++i) {
    const FrameFeatures& features = map.frame(static_cast<int>(i));
    places_[i].reserve(static_cast<size_t>(features.size()));
    for (int k = 0; k < features.size(); ++k) {
      places_[i].push_back({features.keypoint(k).pixel, features.keypoint(k).undistorted});
    }
  }
}

void ShutterCorrection::Apply(const Readout& readout, const Undistorter& undistorter,
                              const std::vector<FrameTrack>& localized,
                              const std::vector<std::optional<FrameMotion>>& motions,
                              Map& map) const {
  for (size_t i = 0; i < localized.size(); ++i) {
    const FrameTrack& track = localized[i];
    if (!track.tracked) continue;
    const auto frame = static_cast<int>(i);
    const FrameFeatures& features = map.frame(frame);
    std::vector<int> point_of_keypoint(static_cast<size_t>(features.size()), kNoIndex);
    for (const PointMatch& match : track.matches) point_of_keypoint[match.keypoint] = match.point;
    const double median_depth = slam::MedianDepth(map, track);
    for (int k = 0; k < features.size(); ++k) {
      const Place& found = places_[i][k];
      const int point = point_of_keypoint[k];
      const double depth =
          point == kNoIndex ? median_depth : (track.cam_from_world * map.point(point).position).z();
      std::optional<Place> moved;
      if (motions[i] && depth > 0.0) {
        moved = Correct(found, depth, readout, undistorter, track.cam_from_world, *motions[i]);
      }
      const Place& place = moved ? *moved : found;
      map.MoveKeypoint(frame, k, place.pixel.cast<double>(), place.undistorted.cast<double>(),
                       features.keypoint(k).sigma);
    }
  }
}

std::optional<ShutterCorrection::Place> ShutterCorrection::Correct(const Place& found, double depth,
                                                                   const Readout& readout,
                                                                   const Undistorter& undistorter,
                                                                   const Rigid3& cam_from_world,
                                                                   const FrameMotion& motion) {
  const PinholeIntrinsics& intrinsics = undistorter.intrinsics();
  const Camera& camera = undistorter.camera();
  const Eigen::Vector2d xy = found.undistorted.cast<double>();
  const Eigen::Vector3d x = depth * intrinsics.Normalize(xy).homogeneous();
  const Eigen::Vector3d when_exposed =
      motion.PointAfter(readout.dot(FromMiddle(camera, found.pixel)), cam_from_world.Inverse() * x);
  if (!(when_exposed.z() > 0.0)) return std::nullopt;
  const Eigen::Vector2d moved = 2.0 * xy - intrinsics.Project(when_exposed);
  const auto pixel = camera.ImageFromCamera(intrinsics.Normalize(moved).homogeneous());
  if (!pixel) return std::nullopt;
  return Place{pixel->cast<float>(), moved.cast<float>()};
}

}  // namespace s3lam
