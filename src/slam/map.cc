#include "s3lam/slam/map.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "s3lam/base/error.h"
#include "s3lam/base/statistics.h"

namespace s3lam {

Map::Map(std::vector<FrameFeatures>& frames, const FeatureOptions& options)
    : frames_(frames),
      level_sigmas_(LevelSigmas(options)),
      log_scale_factor_(std::log(options.scale_factor)) {}

Map& Map::operator=(const Map& other) {
  S3LAM_CHECK(&frames_ == &other.frames_);
  level_sigmas_ = other.level_sigmas_;
  log_scale_factor_ = other.log_scale_factor_;
  keyframes_ = other.keyframes_;
  points_ = other.points_;
  aligned_sigmas_ = other.aligned_sigmas_;
  return *this;
}

int Map::AddKeyframe(int frame, const Rigid3& cam_from_world) {
  Keyframe keyframe;
  keyframe.frame = frame;
  keyframe.cam_from_world = cam_from_world;
  keyframe.point_of_keypoint.assign(static_cast<size_t>(frames_[frame].size()), kNoIndex);
  keyframes_.push_back(std::move(keyframe));
  return num_keyframes() - 1;
}

int Map::AddPoint(const Eigen::Vector3d& position, int first_keyframe) {
  MapPoint point;
  point.position = position;
  point.first_keyframe = first_keyframe;
  points_.push_back(std::move(point));
  return num_points() - 1;
}

bool Map::AddObservation(int point, MapObservation observation) {
  int& slot = keyframes_[observation.keyframe].point_of_keypoint[observation.keypoint];
  if (slot != kNoIndex) return false;
  auto& observations = points_[point].observations;
  const auto place =
      std::lower_bound(observations.begin(), observations.end(), observation.keyframe,
                       [](const MapObservation& o, int keyframe) { return o.keyframe < keyframe; });
  if (place != observations.end() && place->keyframe == observation.keyframe) return false;
  observations.insert(place, observation);
  slot = point;
  return true;
}

void Map::RemoveObservation(int point, int keyframe) {
  auto& observations = points_[point].observations;
  const auto it = std::find_if(observations.begin(), observations.end(),
                               [&](const MapObservation& o) { return o.keyframe == keyframe; });
  if (it == observations.end()) return;
  keyframes_[keyframe].point_of_keypoint[it->keypoint] = kNoIndex;
  observations.erase(it);
  if (observations.size() < 2) ErasePoint(point);
}

void Map::ErasePoint(int point) {
  MapPoint& erased = points_[point];
  for (const MapObservation& o : erased.observations) {
    keyframes_[o.keyframe].point_of_keypoint[o.keypoint] = kNoIndex;
  }
  erased.observations.clear();
  erased.alive = false;
}

void Map::EraseKeyframe(int keyframe) {
  const auto neighbours = Covisible(keyframe);
  if (!neighbours.empty()) {
    const int anchor = neighbours.front().second;
    keyframes_[keyframe].anchor = anchor;
    keyframes_[keyframe].cam_from_anchor =
        keyframes_[keyframe].cam_from_world * keyframes_[anchor].cam_from_world.Inverse();
  }
  std::vector<int> points = keyframes_[keyframe].point_of_keypoint;
  for (const int point : points) {
    if (point != kNoIndex) RemoveObservation(point, keyframe);
  }
  keyframes_[keyframe].alive = false;
}

int Map::EraseWeakKeyframes(int min_points) {
  constexpr size_t kMinKeyframes = 2;
  std::vector<int> alive = AliveKeyframes();
  int num_erased = 0;
  for (; alive.size() > kMinKeyframes; ++num_erased) {
    const auto weakest = std::min_element(alive.begin(), alive.end(), [&](int a, int b) {
      return CountPoints(a, 0) < CountPoints(b, 0);
    });
    if (CountPoints(*weakest, 0) >= min_points) break;
    EraseKeyframe(*weakest);
    alive.erase(weakest);
  }
  return num_erased;
}

void Map::MergePoints(int kept, int dropped) {
  S3LAM_CHECK(kept != dropped);
  const std::vector<MapObservation> observations = points_[dropped].observations;
  points_[kept].num_visible += points_[dropped].num_visible;
  points_[kept].num_found += points_[dropped].num_found;
  ErasePoint(dropped);
  points_[dropped].replaced_by = kept;
  for (const MapObservation& o : observations) AddObservation(kept, o);
  UpdateAppearance(kept);
  UpdateGeometry(kept);
}

void Map::Append(const Map& other, const Similarity3& this_from_other) {
  S3LAM_CHECK(&frames_ == &other.frames_);
  const int first_keyframe = num_keyframes();
  const int first_point = num_points();
  const auto shifted = [](int index, int by) { return index == kNoIndex ? kNoIndex : index + by; };
  for (Keyframe keyframe : other.keyframes_) {
    keyframe.cam_from_world = TransformCameraPose(this_from_other, keyframe.cam_from_world);
    keyframe.anchor = shifted(keyframe.anchor, first_keyframe);
    keyframe.cam_from_anchor.translation *= this_from_other.scale;
    for (int& point : keyframe.point_of_keypoint) point = shifted(point, first_point);
    keyframes_.push_back(std::move(keyframe));
  }
  for (MapPoint point : other.points_) {
    point.position = this_from_other * point.position;
    point.first_keyframe = shifted(point.first_keyframe, first_keyframe);
    point.replaced_by = shifted(point.replaced_by, first_point);
    for (MapObservation& o : point.observations) o.keyframe += first_keyframe;
    points_.push_back(std::move(point));
  }
  for (int p = first_point; p < num_points(); ++p) UpdateGeometry(p);
}

void Map::UpdateAppearance(int index) {
  MapPoint& point = points_[index];
  const size_t n = point.observations.size();
  if (n == 0) return;
  // The descriptor with the least median distance to the others.
  std::vector<const BinaryDescriptor*> descriptors;
  for (const MapObservation& o : point.observations) {
    descriptors.push_back(&features(o.keyframe).descriptor(o.keypoint));
  }
  int best_median = std::numeric_limits<int>::max();
  std::vector<int> distances(n);
  for (size_t i = 0; i < n; ++i) {
    for (size_t j = 0; j < n; ++j) distances[j] = HammingDistance(*descriptors[i], *descriptors[j]);
    const auto middle = distances.begin() + static_cast<std::ptrdiff_t>((n - 1) / 2);
    std::nth_element(distances.begin(), middle, distances.end());
    if (*middle < best_median) {
      best_median = *middle;
      point.descriptor = *descriptors[i];
    }
  }
}

void Map::UpdateGeometry(int index) {
  MapPoint& point = points_[index];
  if (point.observations.empty()) return;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double log_distance = 0.0;
  for (const MapObservation& o : point.observations) {
    const Eigen::Vector3d ray = point.position - keyframes_[o.keyframe].cam_from_world.CenterInB();
    const double distance = ray.norm();
    sum += ray / distance;
    log_distance += std::log(distance * level_sigmas_[keypoint(o).level]);
  }
  point.view_direction = sum.normalized();
  point.level0_distance = std::exp(log_distance / static_cast<double>(point.observations.size()));
}

std::vector<PointMatch> Map::MatchesOf(int keyframe) const {
  std::vector<PointMatch> matches;
  const std::vector<int>& points = keyframes_[keyframe].point_of_keypoint;
  for (size_t i = 0; i < points.size(); ++i) {
    if (points[i] != kNoIndex) matches.push_back({static_cast<int>(i), points[i]});
  }
  return matches;
}

std::vector<int> Map::AliveKeyframes() const {
  std::vector<int> alive;
  for (int k = 0; k < num_keyframes(); ++k) {
    if (keyframes_[k].alive) alive.push_back(k);
  }
  return alive;
}

std::vector<int> Map::KeyframesInTime() const {
  std::vector<int> keyframes = AliveKeyframes();
  std::sort(keyframes.begin(), keyframes.end(),
            [&](int a, int b) { return keyframes_[a].frame < keyframes_[b].frame; });
  return keyframes;
}

size_t Map::NumObservations() const {
  size_t count = 0;
  for (const MapPoint& point : points_) count += point.observations.size();
  return count;
}

int Map::AnchorOf(int keyframe) const {
  while (!keyframes_[keyframe].alive && keyframes_[keyframe].anchor != kNoIndex) {
    keyframe = keyframes_[keyframe].anchor;
  }
  return keyframe;
}

Rigid3 Map::PoseOf(int keyframe) const {
  const Keyframe& k = keyframes_[keyframe];
  if (k.alive || k.anchor == kNoIndex) return k.cam_from_world;
  return k.cam_from_anchor * PoseOf(k.anchor);
}

int Map::Resolve(int point) const {
  while (point != kNoIndex && !points_[point].alive) point = points_[point].replaced_by;
  return point;
}

std::vector<std::pair<int, int>> Map::Covisible(int keyframe) const {
  std::vector<int> shared(keyframes_.size(), 0);
  for (const int point : keyframes_[keyframe].point_of_keypoint) {
    if (point == kNoIndex) continue;
    for (const MapObservation& o : points_[point].observations) ++shared[o.keyframe];
  }
  shared[keyframe] = 0;
  std::vector<std::pair<int, int>> result;
  for (int i = 0; i < num_keyframes(); ++i) {
    if (shared[i] > 0) result.emplace_back(shared[i], i);
  }
  std::sort(result.begin(), result.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first > b.first : a.second < b.second;
  });
  return result;
}

int Map::CountPoints(int keyframe, int min_observations) const {
  int count = 0;
  for (const int point : keyframes_[keyframe].point_of_keypoint) {
    if (point == kNoIndex) continue;
    count += static_cast<int>(points_[point].observations.size()) >= min_observations;
  }
  return count;
}

double Map::MedianDepth(int keyframe) const {
  std::vector<double> depths;
  for (const int point : keyframes_[keyframe].point_of_keypoint) {
    if (point == kNoIndex) continue;
    depths.push_back((keyframes_[keyframe].cam_from_world * points_[point].position).z());
  }
  return Median(std::move(depths));
}

std::vector<int> PointsOf(const Map& map, const std::vector<int>& keyframes) {
  std::vector<int> points;
  for (const int keyframe : keyframes) {
    for (const int point : map.keyframe(keyframe).point_of_keypoint) {
      if (point != kNoIndex) points.push_back(point);
    }
  }
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

}  // namespace s3lam
