#include "s3lam/slam/mapper.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "s3lam/geometry/triangulation.h"

namespace s3lam {
namespace {

constexpr double kChi2 = 5.991;  // 95 %, 2 degrees of freedom.
constexpr double kFuseRadiusPx = 3.0;
constexpr int kNewPointDescriptorDistance = 60;
constexpr int kProbationKeyframes = 3;

/// Chooses variables and gathers the observations of a bundle adjustment.
class ProblemBuilder {
 public:
  ProblemBuilder(const Map& map, const Undistorter& undistorter) : map_(map) {
    problem_.camera = undistorter.intrinsics();
    problem_of_keyframe_.assign(static_cast<size_t>(map.num_keyframes()), kNoIndex);
  }

  void AddKeyframe(int keyframe, bool fixed) {
    if (problem_of_keyframe_[keyframe] != kNoIndex) return;
    problem_of_keyframe_[keyframe] = static_cast<int>(problem_.poses.size());
    keyframes_.push_back(keyframe);
    problem_.poses.push_back(map_.keyframe(keyframe).cam_from_world);
    problem_.pose_is_fixed.push_back(fixed ? 1 : 0);
  }

  /// All observations of a point; keyframes not in the problem yet come in fixed.
  void AddPoint(int point) {
    const int index = static_cast<int>(problem_.points.size());
    points_.push_back(point);
    problem_.points.push_back(map_.point(point).position);
    for (const MapObservation& o : map_.point(point).observations) {
      AddKeyframe(o.keyframe, true);
      const Keypoint& keypoint = map_.keypoint(o);
      problem_.observations.push_back({problem_of_keyframe_[o.keyframe], index,
                                       keypoint.undistorted.cast<double>(), 1.0 / keypoint.sigma});
    }
  }

  BaProblem& problem() { return problem_; }

  /// Writes the solution back and removes observations that do not fit it; returns how many.
  int Apply(double max_squared_error, Map& map) const {
    for (size_t i = 0; i < keyframes_.size(); ++i) {
      if (problem_.pose_is_fixed[i] == 0) map.SetPose(keyframes_[i], problem_.poses[i]);
    }
    for (size_t i = 0; i < points_.size(); ++i) map.SetPosition(points_[i], problem_.points[i]);
    int removed = 0;
    for (const BaObservation& o : problem_.observations) {
      const double error = SquaredError(problem_.camera, problem_.poses[o.pose],
                                        problem_.points[o.point], o.xy, o.inverse_sigma);
      if (error <= max_squared_error || !map.point(points_[o.point]).alive) continue;
      map.RemoveObservation(points_[o.point], keyframes_[o.pose]);
      ++removed;
    }
    for (const int point : points_) {
      if (map.point(point).alive) map.UpdateGeometry(point);
    }
    return removed;
  }

 private:
  const Map& map_;
  BaProblem problem_;
  std::vector<int> problem_of_keyframe_;
  std::vector<int> keyframes_;
  std::vector<int> points_;
};

std::vector<int> Neighbours(const Map& map, int keyframe, int max_count, int min_shared) {
  std::vector<int> neighbours;
  for (const auto& [shared, other] : map.Covisible(keyframe)) {
    if (static_cast<int>(neighbours.size()) >= max_count || shared < min_shared) break;
    neighbours.push_back(other);
  }
  return neighbours;
}

/// Searches the match of a ray of one view along its epipolar line in another, within a range of
/// depths.
class EpipolarSearch {
 public:
  EpipolarSearch(const Map& map, const Undistorter& undistorter, int from, int to)
      : map_(map),
        camera_(undistorter.intrinsics()),
        lower_(undistorter.lower()),
        upper_(undistorter.upper()),
        features_(map.features(to)),
        free_(map.keyframe(to).point_of_keypoint),
        to_from_from_(map.keyframe(to).cam_from_world *
                      map.keyframe(from).cam_from_world.Inverse()),
        max_steps_(std::max(kMinStepLimit, kMaxStepsPerPx * (upper_ - lower_).norm())) {
    FindDepthRange(from);
  }

  /// Keypoint of `to`, or kNoIndex.
  [[nodiscard]] int Find(const Keypoint& keypoint, const BinaryDescriptor& descriptor) const {
    const Eigen::Vector3d ray =
        camera_.Normalize(keypoint.undistorted.cast<double>()).homogeneous();
    const Eigen::Vector3d turned = to_from_from_.rotation * ray;
    // Inverse depths: x = turned + inverse_depth * translation, up to scale.
    const auto near = ProjectAt(turned, max_inverse_depth_);
    const auto far = ProjectAt(turned, 0.0);
    if (!near || !far) return kNoIndex;
    const Eigen::Vector2d along = *near - *far;
    const double length = along.norm();
    const double width = 2.0 * map_.sigma(keypoint.level);
    const double half_box = std::max(8.0, 3.0 * width);
    const int steps = std::max(1, static_cast<int>(std::ceil(length / (2.0 * half_box))));
    if (steps > max_steps_) return kNoIndex;
    const Eigen::Vector2d normal = length > 1e-9
                                       ? Eigen::Vector2d(-along.y() / length, along.x() / length)
                                       : Eigen::Vector2d::Zero();
    int best = kNoIndex;
    int best_distance = kNewPointDescriptorDistance + 1;
    for (int step = 0; step < steps; ++step) {
      const Eigen::Vector2d center = *far + along * ((step + 0.5) / steps);
      if ((center.array() < lower_.array() - half_box).any() ||
          (center.array() > upper_.array() + half_box).any()) {
        continue;
      }
      features_.VisitNear(center, half_box + 1.0, keypoint.level - 2, keypoint.level + 2,
                          [&](int i) {
                            if (free_[i] != kNoIndex) return;
                            const Keypoint& other = features_.keypoint(i);
                            const double off = normal.dot(other.undistorted.cast<double>() - *far);
                            if (std::abs(off) > 2.0 * map_.sigma(other.level)) return;
                            const int d = HammingDistance(descriptor, features_.descriptor(i));
                            if (d < best_distance) {
                              best_distance = d;
                              best = i;
                            }
                          });
    }
    return best;
  }

 private:
  /// Longer lines say too little: of steps per pixel of the image's diagonal, but for small images.
  static constexpr double kMaxStepsPerPx = 0.045;
  static constexpr double kMinStepLimit = 60.0;

  [[nodiscard]] std::optional<Eigen::Vector2d> ProjectAt(const Eigen::Vector3d& turned,
                                                         double inverse_depth) const {
    const Eigen::Vector3d x = turned + inverse_depth * to_from_from_.translation;
    if (x.z() < 0.05) return std::nullopt;
    return camera_.Project(x);
  }

  void FindDepthRange(int from) {
    std::vector<double> depths;
    for (const int point : map_.keyframe(from).point_of_keypoint) {
      if (point == kNoIndex) continue;
      depths.push_back((map_.keyframe(from).cam_from_world * map_.point(point).position).z());
    }
    if (depths.empty()) return;
    const auto low = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 20);
    std::nth_element(depths.begin(), low, depths.end());
    max_inverse_depth_ = *low > 0.0 ? 2.0 / *low : 0.0;
  }

  const Map& map_;
  const PinholeIntrinsics& camera_;
  Eigen::Vector2d lower_;
  Eigen::Vector2d upper_;
  const FrameFeatures& features_;
  const std::vector<int>& free_;
  Rigid3 to_from_from_;
  double max_steps_;
  double max_inverse_depth_ = 0.0;
};

}  // namespace

void MapperOptions::Visit(OptionVisitor& v) {
  v.Value("triangulation_neighbours", triangulation_neighbours,
          "keyframes with which new points are triangulated", 1, 1000);
  v.Value("min_parallax_deg", min_parallax_deg, "of a new point [deg]", 0.0, 30.0);
  v.Value("min_baseline_ratio", min_baseline_ratio, "baseline to median depth of a pair", 0.0, 1.0);
  v.Value("min_found_ratio", min_found_ratio,
          "a point is kept if found in this share of the frames that should see it", 0.0, 1.0);
  v.Value("local_keyframes", local_keyframes, "free keyframes of a local bundle adjustment", 1,
          10000);
  v.Value("min_shared_points", min_shared_points, "points that neighbouring keyframes share", 1,
          10000);
  v.Value("redundant_share", redundant_share,
          "a keyframe goes when this share of its points is seen by three others", 0.1, 1.0);
  v.Group("local_ba", local_ba, "bundle adjustment around a new keyframe");
  v.Group("global_ba", global_ba, "bundle adjustment of the whole map");
}

int Mapper::AddKeyframe(Map& map, int frame, const FrameTrack& track) {
  const int keyframe = map.AddKeyframe(frame, CurrentPose(map, track));
  for (const PointMatch& match : track.matches) {
    const int point = map.Resolve(match.point);
    if (point != kNoIndex && map.AddObservation(point, {keyframe, match.keypoint})) {
      map.UpdateAppearance(point);
      map.UpdateGeometry(point);
    }
  }
  CullRecentPoints(map, keyframe);
  const std::vector<int> created =
      TriangulateNewPoints(map, keyframe, options_.triangulation_neighbours);
  recent_points_.insert(recent_points_.end(), created.begin(), created.end());
  FuseWithNeighbours(map, keyframe, options_.triangulation_neighbours);
  AdjustLocally(map, keyframe);
  CullKeyframes(map, keyframe);
  return keyframe;
}

void Mapper::CullRecentPoints(Map& map, int keyframe) {
  std::erase_if(recent_points_, [&](int index) {
    const MapPoint& point = map.point(index);
    if (!point.alive) return true;
    const int age = keyframe - point.first_keyframe;
    const bool rarely_found = point.num_found < options_.min_found_ratio * point.num_visible;
    const bool rarely_seen = age >= 2 && point.observations.size() <= 2;
    if (rarely_found || rarely_seen) {
      map.ErasePoint(index);
      return true;
    }
    return age >= kProbationKeyframes;
  });
}

std::vector<int> Mapper::TriangulateNewPoints(Map& map, int keyframe, int num_neighbours) const {
  std::vector<int> created;
  const double depth = map.MedianDepth(keyframe);
  if (depth <= 0.0) return created;
  const Eigen::Vector3d center = map.keyframe(keyframe).cam_from_world.CenterInB();
  for (const int neighbour :
       Neighbours(map, keyframe, num_neighbours, options_.min_shared_points)) {
    const double baseline = (map.keyframe(neighbour).cam_from_world.CenterInB() - center).norm();
    if (baseline < options_.min_baseline_ratio * depth) continue;
    TriangulatePair(map, keyframe, neighbour, created);
  }
  return created;
}

int Mapper::TriangulatePair(Map& map, int keyframe, int neighbour,
                            std::vector<int>& created) const {
  const PinholeIntrinsics& camera = undistorter_.intrinsics();
  const EpipolarSearch search(map, undistorter_, keyframe, neighbour);
  const Rigid3 pose_a = map.keyframe(keyframe).cam_from_world;
  const Rigid3 pose_b = map.keyframe(neighbour).cam_from_world;
  const FrameFeatures& features_a = map.features(keyframe);
  const FrameFeatures& features_b = map.features(neighbour);
  const double min_parallax = options_.min_parallax_deg * std::numbers::pi / 180.0;
  int count = 0;
  for (int a = 0; a < features_a.size(); ++a) {
    if (map.keyframe(keyframe).point_of_keypoint[a] != kNoIndex) continue;
    const Keypoint& keypoint_a = features_a.keypoint(a);
    const int b = search.Find(keypoint_a, features_a.descriptor(a));
    if (b == kNoIndex) continue;
    const Keypoint& keypoint_b = features_b.keypoint(b);
    const Eigen::Vector2d xy_a = keypoint_a.undistorted.cast<double>();
    const Eigen::Vector2d xy_b = keypoint_b.undistorted.cast<double>();
    const std::array<ViewingRay, 2> rays{ViewingRay{pose_a, camera.Normalize(xy_a)},
                                         ViewingRay{pose_b, camera.Normalize(xy_b)}};
    const auto point = Triangulate(rays);
    if (!point) continue;
    const Eigen::Vector3d center_a = pose_a.CenterInB();
    const Eigen::Vector3d center_b = pose_b.CenterInB();
    if (ParallaxAngle(*point, center_a, center_b) < min_parallax) continue;
    if (SquaredError(camera, pose_a, *point, xy_a, 1.0 / keypoint_a.sigma) > kChi2 ||
        SquaredError(camera, pose_b, *point, xy_b, 1.0 / keypoint_b.sigma) > kChi2) {
      continue;
    }
    // The scales at which the two see it must agree with the distances.
    const double ratio = (*point - center_b).norm() * map.sigma(keypoint_b.level) /
                         ((*point - center_a).norm() * map.sigma(keypoint_a.level));
    if (ratio > 1.8 || ratio < 1.0 / 1.8) continue;
    const int index = map.AddPoint(*point, keyframe);
    map.AddObservation(index, {keyframe, a});
    map.AddObservation(index, {neighbour, b});
    map.UpdateAppearance(index);
    map.UpdateGeometry(index);
    created.push_back(index);
    ++count;
  }
  return count;
}

void Mapper::FuseInto(Map& map, const std::vector<int>& points, int keyframe) const {
  std::vector<int> candidates;
  for (const int point : points) {
    if (!map.point(point).alive) continue;
    const auto& observations = map.point(point).observations;
    const bool seen = std::any_of(observations.begin(), observations.end(),
                                  [&](const MapObservation& o) { return o.keyframe == keyframe; });
    if (!seen) candidates.push_back(point);
  }
  ProjectionSearch search;
  search.radius_px = kFuseRadiusPx;
  search.max_distance = kStrictDescriptorDistance;
  search.max_ratio = 1.0;
  const Rigid3 pose = map.keyframe(keyframe).cam_from_world;
  const FrameView view{&map.features(keyframe), &undistorter_, pose};
  for (const PointMatch& match : MatchByProjection(map, candidates, view, {}, search)) {
    const int point = map.Resolve(match.point);
    if (point == kNoIndex) continue;
    const Keypoint& keypoint = map.features(keyframe).keypoint(match.keypoint);
    if (SquaredError(undistorter_.intrinsics(), pose, map.point(point).position,
                     keypoint.undistorted.cast<double>(), 1.0 / keypoint.sigma) > kChi2) {
      continue;
    }
    const int present = map.keyframe(keyframe).point_of_keypoint[match.keypoint];
    if (present == point) continue;
    if (present == kNoIndex) {
      if (map.AddObservation(point, {keyframe, match.keypoint})) map.UpdateGeometry(point);
      continue;
    }
    const bool keep_present =
        map.point(present).observations.size() >= map.point(point).observations.size();
    map.MergePoints(keep_present ? present : point, keep_present ? point : present);
  }
}

void Mapper::FuseWithNeighbours(Map& map, int keyframe, int num_neighbours) const {
  const std::vector<int> neighbours =
      Neighbours(map, keyframe, num_neighbours, options_.min_shared_points);
  const std::vector<int> own = PointsOf(map, {keyframe});
  for (const int neighbour : neighbours) FuseInto(map, own, neighbour);
  FuseInto(map, PointsOf(map, neighbours), keyframe);
}

void Mapper::AdjustLocally(Map& map, int keyframe) const {
  std::vector<int> local =
      Neighbours(map, keyframe, options_.local_keyframes - 1, options_.min_shared_points);
  local.push_back(keyframe);
  std::sort(local.begin(), local.end());
  ProblemBuilder builder(map, undistorter_);
  // The first keyframe of the map holds the gauge while everything else is still free.
  for (const int k : local) builder.AddKeyframe(k, k == 0);
  for (const int point : PointsOf(map, local)) builder.AddPoint(point);
  AdjustBundle(options_.local_ba, builder.problem());
  builder.Apply(kChi2, map);
}

void Mapper::CullKeyframes(Map& map, int keyframe) const {
  std::vector<int> neighbours = Neighbours(map, keyframe, map.num_keyframes(), 1);
  for (const int candidate : neighbours) {
    if (candidate <= 1) continue;  // The initial pair holds the gauge.
    int points = 0;
    int redundant = 0;
    for (size_t i = 0; i < map.keyframe(candidate).point_of_keypoint.size(); ++i) {
      const int point = map.keyframe(candidate).point_of_keypoint[i];
      if (point == kNoIndex) continue;
      ++points;
      const int level = map.features(candidate).keypoint(static_cast<int>(i)).level;
      int finer = 0;
      for (const MapObservation& o : map.point(point).observations) {
        finer += o.keyframe != candidate && map.keypoint(o).level <= level + 1;
      }
      redundant += finer >= 3;
    }
    if (redundant > options_.redundant_share * points) map.EraseKeyframe(candidate);
  }
}

void Mapper::AdjustGlobally(Map& map, int rounds, int num_threads, double max_sigma) const {
  for (int round = 0; round < rounds; ++round) {
    ProblemBuilder builder(map, undistorter_);
    for (int k = 0; k < map.num_keyframes(); ++k) {
      if (map.keyframe(k).alive) builder.AddKeyframe(k, k == 0);
    }
    for (int p = 0; p < map.num_points(); ++p) {
      if (map.point(p).alive) builder.AddPoint(p);
    }
    BundleAdjustmentOptions options = options_.global_ba;
    options.num_threads = num_threads;
    AdjustBundle(options, builder.problem());
    if (builder.Apply(max_sigma * max_sigma, map) == 0) break;
  }
}

}  // namespace s3lam
