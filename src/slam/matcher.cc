#include "s3lam/slam/matcher.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace s3lam {
namespace {

constexpr double kMinViewCosine = 0.5;
constexpr int kNoDistance = 257;

struct Candidate {
  int keypoint = kNoIndex;
  int distance = kNoDistance;
};

/// The best keypoint for a descriptor near a place, or none.
Candidate FindBest(const FrameFeatures& features, const BinaryDescriptor& descriptor,
                   const Eigen::Vector2d& xy, double radius, int min_level, int max_level,
                   std::span<const uint8_t> taken, const ProjectionSearch& search) {
  Candidate best;
  int second = kNoDistance;
  int best_level = kNoIndex;
  int second_level = kNoIndex;
  features.VisitNear(xy, radius, min_level, max_level, [&](int i) {
    if (!taken.empty() && taken[i] != 0) return;
    const int distance = HammingDistance(descriptor, features.descriptor(i));
    const int level = features.keypoint(i).level;
    if (distance < best.distance) {
      second = best.distance;
      second_level = best_level;
      best = {i, distance};
      best_level = level;
    } else if (distance < second) {
      second = distance;
      second_level = level;
    }
  });
  if (best.distance > search.max_distance) return {};
  if (best_level == second_level && best.distance > search.max_ratio * second) return {};
  return best;
}

}  // namespace

std::optional<Projection> PredictProjection(const Map& map, const MapPoint& point,
                                            const FrameView& view) {
  const Eigen::Vector3d x = view.cam_from_world * point.position;
  if (x.z() <= 1e-6) return std::nullopt;
  Projection projection;
  projection.xy = view.undistorter->intrinsics().Project(x);
  if ((projection.xy.array() < view.undistorter->lower().array()).any() ||
      (projection.xy.array() > view.undistorter->upper().array()).any()) {
    return std::nullopt;
  }
  const double distance = x.norm();
  projection.view_cosine = (view.cam_from_world.rotation * point.view_direction).dot(x) / distance;
  if (projection.view_cosine < kMinViewCosine) return std::nullopt;
  const double level = std::log(point.level0_distance / distance) / map.log_scale_factor();
  if (level < -1.5 || level > map.num_levels() + 0.5) return std::nullopt;
  projection.level = std::clamp(static_cast<int>(std::lround(level)), 0, map.num_levels() - 1);
  return projection;
}

std::vector<PointMatch> MatchByProjection(const Map& map, std::span<const int> points,
                                          const FrameView& view, std::span<const uint8_t> taken,
                                          const ProjectionSearch& search) {
  const FrameFeatures& features = *view.features;
  std::vector<Candidate> best_of_keypoint(
      static_cast<size_t>(features.size()));  // .keypoint: point
  for (const int index : points) {
    const MapPoint& point = map.point(index);
    const auto projection = PredictProjection(map, point, view);
    if (!projection) continue;
    // A point seen at a slant moves more with the pose's error.
    const double slant = projection->view_cosine < 0.998 ? 1.6 : 1.0;
    const Candidate found = FindBest(features, point.descriptor, projection->xy,
                                     search.radius_px * slant * map.sigma(projection->level),
                                     projection->level - search.levels_below,
                                     projection->level + search.levels_above, taken, search);
    if (found.keypoint == kNoIndex) continue;
    Candidate& current = best_of_keypoint[found.keypoint];
    if (found.distance < current.distance) current = {index, found.distance};
  }
  std::vector<PointMatch> matches;
  for (int i = 0; i < features.size(); ++i) {
    if (best_of_keypoint[i].keypoint != kNoIndex)
      matches.push_back({i, best_of_keypoint[i].keypoint});
  }
  return matches;
}

void KeepConsistentRotations(std::span<const float> angles, std::vector<KeypointMatch>& matches) {
  constexpr int kBins = 30;
  constexpr double kTurn = 2.0 * std::numbers::pi;
  const auto bin_of = [](float angle) {
    const double turns = static_cast<double>(angle) / kTurn;
    return static_cast<int>((turns - std::floor(turns)) * kBins) % kBins;
  };
  std::array<int, kBins> counts{};
  for (const float angle : angles) ++counts[static_cast<size_t>(bin_of(angle))];
  // The fullest bin and its neighbours, and others nearly as full.
  const int peak = *std::max_element(counts.begin(), counts.end());
  std::array<bool, kBins> keeps{};
  for (int bin = 0; bin < kBins; ++bin) {
    if (counts[static_cast<size_t>(bin)] * 3 < peak * 2) continue;
    for (const int near : {bin + kBins - 1, bin, bin + 1}) {
      keeps[static_cast<size_t>(near % kBins)] = true;
    }
  }
  std::vector<KeypointMatch> kept;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (keeps[static_cast<size_t>(bin_of(angles[i]))]) kept.push_back(matches[i]);
  }
  matches.swap(kept);
}

std::vector<KeypointMatch> MatchDescriptors(const FrameFeatures& a, const FrameFeatures& b,
                                            std::span<const int> keypoints_a,
                                            std::span<const int> keypoints_b, int max_distance,
                                            double max_ratio) {
  std::vector<Candidate> best_for_b(keypoints_b.size());
  struct Forward {
    size_t b = 0;
    int distance = kNoDistance;
    int second = kNoDistance;
  };
  std::vector<Forward> forward(keypoints_a.size());
  for (size_t i = 0; i < keypoints_a.size(); ++i) {
    const BinaryDescriptor& descriptor = a.descriptor(keypoints_a[i]);
    for (size_t j = 0; j < keypoints_b.size(); ++j) {
      const int distance = HammingDistance(descriptor, b.descriptor(keypoints_b[j]));
      if (distance < forward[i].distance) {
        forward[i].second = forward[i].distance;
        forward[i].distance = distance;
        forward[i].b = j;
      } else if (distance < forward[i].second) {
        forward[i].second = distance;
      }
      if (distance < best_for_b[j].distance) best_for_b[j] = {static_cast<int>(i), distance};
    }
  }
  std::vector<KeypointMatch> matches;
  for (size_t i = 0; i < keypoints_a.size(); ++i) {
    const Forward& f = forward[i];
    if (f.distance > max_distance || f.distance > max_ratio * f.second) continue;
    if (best_for_b[f.b].keypoint != static_cast<int>(i)) continue;
    matches.push_back({keypoints_a[i], keypoints_b[f.b]});
  }
  return matches;
}

std::vector<KeypointMatch> MatchByLooks(const FrameFeatures& a, const FrameFeatures& b,
                                        std::span<const int> keypoints_a,
                                        std::span<const int> keypoints_b, int max_distance,
                                        double max_ratio) {
  std::vector<KeypointMatch> matches =
      MatchDescriptors(a, b, keypoints_a, keypoints_b, max_distance, max_ratio);
  std::vector<float> turns;
  for (const KeypointMatch& match : matches) {
    turns.push_back(b.keypoint(match.b).angle - a.keypoint(match.a).angle);
  }
  KeepConsistentRotations(turns, matches);
  return matches;
}

}  // namespace s3lam
