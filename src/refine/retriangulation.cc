#include "s3lam/refine/retriangulation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <optional>
#include <tuple>

#include "s3lam/base/statistics.h"
#include "s3lam/geometry/triangulation.h"
#include "s3lam/refine/projection.h"

namespace s3lam {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
constexpr double kChi95TwoDof = 2.4477;  // sqrt(5.991)
/// Pairs of observations that may propose a point.
constexpr size_t kMaxPairs = 30;

/// Observations [begin, end) of each point.
std::vector<std::pair<size_t, size_t>> RangesOfPoints(const BundleMap& map) {
  std::vector<std::pair<size_t, size_t>> ranges(map.point_ids.size(), {0, 0});
  const auto& observations = map.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const int point = observations[begin].point;
    while (end < observations.size() && observations[end].point == point) ++end;
    ranges[point] = {begin, end};
  }
  return ranges;
}

/// Geometry of a map's observations at the present poses.
class Observer {
 public:
  explicit Observer(const BundleMap& map) : map_(map) {
    for (const PoseBlock& pose : map.problem.poses) poses_.push_back(FromPoseBlock(pose.data()));
  }

  [[nodiscard]] const Camera& CameraOf(size_t k) const {
    return map_.problem.cameras[map_.problem.camera_of_pose[map_.observations[k].pose]];
  }

  [[nodiscard]] std::optional<ViewingRay> Ray(size_t k) const {
    const auto normalized = CameraOf(k).CameraFromImage(map_.observations[k].pixel);
    if (!normalized) return std::nullopt;
    return ViewingRay{poses_[map_.observations[k].pose], *normalized};
  }

  /// Reprojection error of an observation if its point were here, in relative sigmas of its
  /// keypoint [px]; infinite from behind.
  [[nodiscard]] double Error(size_t k, const Eigen::Vector3d& point) const {
    const Camera& camera = CameraOf(k);
    Eigen::Vector2d pixel;
    if (!ProjectPoint(camera.model, camera.params.data(), poses_[map_.observations[k].pose] * point,
                      &pixel, nullptr)) {
      return std::numeric_limits<double>::infinity();
    }
    return (pixel - map_.observations[k].pixel).norm() / map_.observations[k].sigma;
  }

 private:
  const BundleMap& map_;
  std::vector<Rigid3> poses_;
};

/// Rays of the observations and which observations they are of.
struct Rays {
  std::vector<ViewingRay> rays;
  std::vector<size_t> observations;
};

double LargestAngle(const std::vector<ViewingRay>& rays, const Eigen::Vector3d& point) {
  double largest = 0.0;
  for (size_t a = 0; a < rays.size(); ++a) {
    for (size_t b = a + 1; b < rays.size(); ++b) {
      largest = std::max(largest, ParallaxAngle(point, rays[a].cam_from_world.CenterInB(),
                                                rays[b].cam_from_world.CenterInB()));
    }
  }
  return largest;
}

std::vector<size_t> FittingRays(const Observer& observer, const Rays& all,
                                const Eigen::Vector3d& point, double max_error_px) {
  std::vector<size_t> fitting;
  for (size_t r = 0; r < all.rays.size(); ++r) {
    if (observer.Error(all.observations[r], point) <= max_error_px) fitting.push_back(r);
  }
  return fitting;
}

/// The place that the most observations agree on, of those that two observations propose.
std::optional<Eigen::Vector3d> BestPlace(const Observer& observer, const Rays& all,
                                         double max_error_px, double min_angle, size_t more_than) {
  std::vector<size_t> best;
  const size_t n = all.rays.size();
  size_t tried = 0;
  // Farthest apart first: they see the point from the most different directions.
  for (size_t gap = n - 1; gap >= 1 && tried < kMaxPairs; --gap) {
    for (size_t a = 0; a + gap < n && tried < kMaxPairs; ++a, ++tried) {
      const std::array<ViewingRay, 2> pair{all.rays[a], all.rays[a + gap]};
      const auto place = Triangulate(pair);
      if (!place) continue;
      std::vector<size_t> fitting = FittingRays(observer, all, *place, max_error_px);
      if (fitting.size() > best.size()) best = std::move(fitting);
    }
  }
  if (best.size() < 2 || best.size() <= more_than) return std::nullopt;
  std::vector<ViewingRay> rays;
  for (const size_t r : best) rays.push_back(all.rays[r]);
  const auto place = Triangulate(rays);
  if (!place || LargestAngle(rays, *place) < min_angle) return std::nullopt;
  if (FittingRays(observer, all, *place, max_error_px).size() <= more_than) return std::nullopt;
  return place;
}

/// Pairs of points near each other, found through grids of cubes, those of each grid half as large
/// as those of the one before. A point is in the finest grid whose cubes are at least 2 reach_px of
/// its pixels wide, however many points are farther away. The coarsest grid is that of the median
/// pixel: of points much farther away only those within a common cube's reach are compared.
class NearbyPoints {
 public:
  NearbyPoints(const std::vector<Eigen::Vector3d>& points, const std::vector<double>& pixel_sizes,
               const std::vector<int>& chosen, double reach_px)
      : points_(points), level_(points.size(), 0) {
    std::vector<double> sizes;
    for (const int i : chosen) sizes.push_back(pixel_sizes[i]);
    const double median = Median(std::move(sizes));
    inverse_size_ = 1.0 / (reach_px * 2.0 * median);
    for (const int i : chosen) {
      level_[i] = std::clamp(std::ilogb(median / pixel_sizes[i]), 0, kMaxLevel);
      cells_[CellOf(points[i], level_[i])].push_back(i);
    }
  }

  /// Calls visit(a, b), a before b, for the pairs of point i with the points in the cubes around
  /// it, in such a way that over all i every pair is visited once.
  template <typename Visitor>
  void VisitPairs(int i, Visitor&& visit) const {
    for (int level = level_[i]; level >= 0; --level) {
      const Cell center = CellOf(points_[i], level);
      for (int64_t x = -1; x <= 1; ++x) {
        for (int64_t y = -1; y <= 1; ++y) {
          for (int64_t z = -1; z <= 1; ++z) {
            const auto it = cells_.find({level, center[1] + x, center[2] + y, center[3] + z});
            if (it == cells_.end()) continue;
            for (const int j : it->second) {
              if (level < level_[i] || j > i) visit(std::min(i, j), std::max(i, j));
            }
          }
        }
      }
    }
  }

 private:
  using Cell = std::array<int64_t, 4>;  // Level and place.
  static constexpr int kMaxLevel = 20;

  [[nodiscard]] Cell CellOf(const Eigen::Vector3d& point, int level) const {
    const double inverse_size = std::ldexp(inverse_size_, level);
    Cell cell{level};
    for (int c = 0; c < 3; ++c) {
      const double index = std::floor(point[c] * inverse_size);
      cell[static_cast<size_t>(c) + 1] = static_cast<int64_t>(std::clamp(index, -9e15, 9e15));
    }
    return cell;
  }

  const std::vector<Eigen::Vector3d>& points_;
  std::vector<int> level_;
  double inverse_size_ = 0.0;  // Of the coarsest grid.
  std::map<Cell, std::vector<int>> cells_;
};

struct Merge {
  double distance_px = 0.0;
  int kept = 0;
  int gone = 0;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
};

/// Where both points would be one; empty if they are not.
std::optional<Eigen::Vector3d> CommonPlace(const Observer& observer, const BundleMap& map,
                                           const std::pair<size_t, size_t>& a,
                                           const std::pair<size_t, size_t>& b,
                                           double max_error_px) {
  Rays all;
  std::vector<int> poses;
  for (const auto& [begin, end] : {a, b}) {
    for (size_t k = begin; k < end; ++k) {
      if (map.is_used[k] == 0) continue;
      const auto ray = observer.Ray(k);
      if (!ray) return std::nullopt;
      all.rays.push_back(*ray);
      all.observations.push_back(k);
      poses.push_back(map.observations[k].pose);
    }
  }
  std::sort(poses.begin(), poses.end());
  if (std::adjacent_find(poses.begin(), poses.end()) != poses.end()) return std::nullopt;
  const auto place = Triangulate(all.rays);
  if (!place || FittingRays(observer, all, *place, max_error_px).size() < all.rays.size()) {
    return std::nullopt;
  }
  return place;
}

/// Points in use that may move and of which it is known what they look like.
std::vector<int> MergeablePoints(const std::vector<double>& pixel_size, const BundleMap& map) {
  std::vector<int> points;
  for (size_t i = 0; i < pixel_size.size(); ++i) {
    const int point = static_cast<int>(i);
    if (!(pixel_size[i] > 0.0) || !map.looks[i].is_known) continue;
    if (!map.problem.IsConstantPoint(point)) points.push_back(point);
  }
  return points;
}

bool LookAlike(const RetriangulationOptions& options, const PointLook& a, const PointLook& b) {
  return a.group == b.group &&
         HammingDistance(a.descriptor, b.descriptor) <= options.max_descriptor_distance;
}

/// Pairs of points that are the same, nearest first.
std::vector<Merge> ProposeMerges(const RetriangulationOptions& options, double sigma_px,
                                 const BundleMap& map) {
  const std::vector<double> pixel_size = PixelSizes(map.problem);
  const std::vector<int> chosen = MergeablePoints(pixel_size, map);
  if (chosen.size() < 2 || !(options.max_merge_px > 0.0)) return {};
  const NearbyPoints nearby(map.problem.points, pixel_size, chosen, options.max_merge_px);
  const Observer observer(map);
  const auto ranges = RangesOfPoints(map);
  std::vector<Merge> merges;
  const auto propose = [&](int a, int b) {
    const double distance_px = (map.problem.points[a] - map.problem.points[b]).norm() /
                               std::max(pixel_size[a], pixel_size[b]);
    if (distance_px > options.max_merge_px || !LookAlike(options, map.looks[a], map.looks[b])) {
      return;
    }
    const auto place = CommonPlace(observer, map, ranges[a], ranges[b], kChi95TwoDof * sigma_px);
    if (!place) return;
    const bool a_is_longer =
        ranges[a].second - ranges[a].first >= ranges[b].second - ranges[b].first;
    merges.push_back({distance_px, a_is_longer ? a : b, a_is_longer ? b : a, *place});
  };
  for (const int i : chosen) nearby.VisitPairs(i, propose);
  std::sort(merges.begin(), merges.end(), [](const Merge& a, const Merge& b) {
    return std::tuple(a.distance_px, std::minmax(a.kept, a.gone)) <
           std::tuple(b.distance_px, std::minmax(b.kept, b.gone));
  });
  return merges;
}

/// Gives the observations of points that are gone to those that are kept, and groups them again.
void MoveObservations(const std::vector<int>& merged_into, BundleMap& map) {
  for (BundleObservation& o : map.observations) o.point = merged_into[o.point];
  std::vector<size_t> order(map.observations.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return std::pair(map.observations[a].point, map.elements[a]) <
           std::pair(map.observations[b].point, map.elements[b]);
  });
  BundleMap sorted;
  for (const size_t k : order) {
    sorted.observations.push_back(map.observations[k]);
    sorted.elements.push_back(map.elements[k]);
    sorted.is_used.push_back(map.is_used[k]);
  }
  map.observations = std::move(sorted.observations);
  map.elements = std::move(sorted.elements);
  map.is_used = std::move(sorted.is_used);
  map.problem.observations.clear();
  for (size_t k = 0; k < map.observations.size(); ++k) {
    if (map.is_used[k] != 0) map.problem.observations.push_back(map.observations[k]);
  }
}

/// Each point takes part in the first of its merges. Returns how many there are.
size_t ApplyMerges(const std::vector<Merge>& merges, BundleMap& map) {
  std::vector<int> merged_into(map.point_ids.size());
  std::iota(merged_into.begin(), merged_into.end(), 0);
  std::vector<uint8_t> taken(map.point_ids.size(), 0);
  size_t count = 0;
  for (const Merge& merge : merges) {
    if (taken[merge.kept] != 0 || taken[merge.gone] != 0) continue;
    taken[merge.kept] = taken[merge.gone] = 1;
    merged_into[merge.gone] = merge.kept;
    map.merged_into[map.point_ids[merge.gone]] = map.point_ids[merge.kept];
    map.problem.points[merge.kept] = merge.place;
    ++count;
  }
  if (count > 0) MoveObservations(merged_into, map);
  return count;
}

}  // namespace

void RetriangulationOptions::Visit(OptionVisitor& v) {
  v.Value("enabled", enabled,
          "triangulate points anew, between solves, whose observations do not all fit");
  v.Value("min_angle_deg", min_angle_deg,
          "least angle between two views of a point triangulated anew [deg]", 0.0, 90.0);
  v.Value(
      "merge", merge,
      "make one point of two that are the same, where descriptors.bin says what they look like");
  v.Value("max_descriptor_distance", max_descriptor_distance,
          "points whose descriptors differ in more bits are not the same", 0, 256);
  v.Value("max_merge_px", max_merge_px,
          "nor are points farther apart, as the cameras see them [px]", 0.0, 1000.0);
}

size_t RetriangulatePoints(const RetriangulationOptions& options, const OutlierOptions& outliers,
                           double sigma_px, BundleMap& map) {
  if (!options.enabled) return 0;
  const Observer observer(map);
  const double max_error_px = outliers.max_reprojection_sigma * sigma_px;
  size_t moved = 0;
  const auto ranges = RangesOfPoints(map);
  for (size_t i = 0; i < ranges.size(); ++i) {
    const auto [begin, end] = ranges[i];
    if (end - begin < 2 || map.problem.IsConstantPoint(static_cast<int>(i))) continue;
    size_t fitting = 0;
    for (size_t k = begin; k < end; ++k) {
      fitting += observer.Error(k, map.problem.points[i]) <= max_error_px;
    }
    // Where most fit, the others are wrong and not the point.
    if (fitting >= 2 && 2 * fitting >= end - begin) continue;
    Rays all;
    for (size_t k = begin; k < end; ++k) {
      const auto ray = observer.Ray(k);
      if (!ray) continue;
      all.rays.push_back(*ray);
      all.observations.push_back(k);
    }
    if (all.rays.size() < 2) continue;
    const auto place = BestPlace(observer, all, max_error_px, options.min_angle_deg / kDegrees,
                                 std::max<size_t>(fitting, 1));
    if (!place) continue;
    map.problem.points[i] = *place;
    ++moved;
  }
  return moved;
}

void AddLooks(const PointDescriptors& descriptors, const SemanticMap& semantics, BundleMap& map) {
  map.looks.assign(descriptors.empty() ? 0 : map.point_ids.size(), {});
  for (size_t i = 0; i < map.looks.size(); ++i) {
    const auto it = descriptors.find(map.point_ids[i]);
    map.looks[i].is_known = it != descriptors.end();
    if (map.looks[i].is_known) map.looks[i].descriptor = it->second;
  }
  if (map.looks.empty()) return;
  for (size_t row = 0; row < semantics.points.size(); ++row) {
    const int i = map.IndexOfPoint(semantics.points[row]);
    const ClusterId cluster = semantics.cluster_of_point[row];
    if (i >= 0 && cluster.valid()) map.looks[i].group = static_cast<int>(cluster.value());
  }
}

size_t MergePoints(const RetriangulationOptions& options, double sigma_px, BundleMap& map) {
  if (!options.enabled || !options.merge || map.looks.empty()) return 0;
  return ApplyMerges(ProposeMerges(options, sigma_px, map), map);
}

}  // namespace s3lam
