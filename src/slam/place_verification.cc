#include "s3lam/slam/place_verification.h"

#include <algorithm>
#include <array>

#include "s3lam/base/log.h"
#include "s3lam/slam/similarity_estimator.h"

namespace s3lam {
namespace {

constexpr double kChi2 = 9.21;  // 99 %, 2 degrees of freedom.
constexpr int kMinMatches = 15;
constexpr size_t kMinSampleInliers = 12;
constexpr int kDescriptorDistance = 64;
constexpr double kDescriptorRatio = 0.85;
constexpr double kSearchRadiusPx = 8.0;
constexpr int kGuidedRounds = 2;
constexpr int kMinSupportPoints = 20;
/// A neighbour looks from elsewhere and has a share in the drift.
constexpr double kSupportShare = 0.5;

/// A keyframe, those around it, and all their points.
struct Neighbourhood {
  Neighbourhood(const PlaceView& view, int max_neighbours)
      : map(*view.map), keyframe(view.keyframe) {
    for (const auto& [shared, other] : map.Covisible(keyframe)) {
      if (static_cast<int>(neighbours.size()) == max_neighbours) break;
      neighbours.push_back(other);
    }
    std::vector<int> all = neighbours;
    all.push_back(keyframe);
    points = PointsOf(map, all);
  }

  const Map& map;
  int keyframe;
  std::vector<int> neighbours;
  std::vector<int> points;
};

/// Points of one neighbourhood looked for in a keyframe of the other.
struct Sighting {
  std::vector<PointMatch> found;  // Points of the one, keypoints of the other.
  int num_visible = 0;

  [[nodiscard]] double FoundShare() const {
    return num_visible > 0 ? static_cast<double>(found.size()) / num_visible : 0.0;
  }
};

class Verifier {
 public:
  Verifier(const PlaceVerificationOptions& options, const Undistorter& undistorter,
           const PlaceView& a, const PlaceView& b)
      : options_(options),
        undistorter_(undistorter),
        a_(a, options.neighbours),
        b_(b, options.neighbours) {}

  std::optional<PlaceMatch> Run() {
    MatchByDescriptors();
    if (static_cast<int>(points_.size()) < kMinMatches) return std::nullopt;
    const auto fit = EstimateSimilarity(undistorter_.intrinsics(), MakePairs(points_),
                                        kMinSampleInliers, options_.seed);
    if (!fit) return std::nullopt;
    PlaceMatch match;
    match.keyframe_a = a_.keyframe;
    match.keyframe_b = b_.keyframe;
    match.a_from_b = fit->a_from_b;
    for (int round = 0; round < kGuidedRounds; ++round) {
      if (!SearchAgain(match)) return std::nullopt;
    }
    match.support = Support(a_, b_, match.world_a_from_world_b) +
                    Support(b_, a_, match.world_a_from_world_b.Inverse());
    const size_t asked = a_.neighbours.size() + b_.neighbours.size();
    const bool accepted = match.found_share >= options_.min_found_share &&
                          match.support >= std::min(options_.min_support, static_cast<int>(asked));
    spdlog::debug("keyframes {} and {}: {} points, {:.2f} found, support {}: {}", a_.keyframe,
                  b_.keyframe, match.points.size(), match.found_share, match.support,
                  accepted ? "the same place" : "not the same place");
    if (!accepted) return std::nullopt;
    return match;
  }

 private:
  void MatchByDescriptors() {
    const FrameFeatures& features_a = a_.map.features(a_.keyframe);
    const FrameFeatures& features_b = b_.map.features(b_.keyframe);
    const auto with_point = [](const Neighbourhood& n) {
      std::vector<int> keypoints;
      for (const PointMatch& match : n.map.MatchesOf(n.keyframe)) {
        keypoints.push_back(match.keypoint);
      }
      return keypoints;
    };
    for (const KeypointMatch& match :
         MatchByLooks(features_a, features_b, with_point(a_), with_point(b_), kDescriptorDistance,
                      kDescriptorRatio)) {
      points_.emplace_back(a_.map.keyframe(a_.keyframe).point_of_keypoint[match.a],
                           b_.map.keyframe(b_.keyframe).point_of_keypoint[match.b]);
      keypoints_.emplace_back(match.a, match.b);
    }
  }

  /// Where a point is in a camera and where that should see it: its keypoint, if it has one.
  void FillSide(const Neighbourhood& n, int point, int keypoint, Eigen::Vector3d& position,
                Eigen::Vector2d& xy, double& inverse_sigma) const {
    position = n.map.keyframe(n.keyframe).cam_from_world * n.map.point(point).position;
    const Keypoint& k = n.map.features(n.keyframe).keypoint(keypoint);
    xy = k.undistorted.cast<double>();
    inverse_sigma = 1.0 / n.map.sigma(k.level);
  }

  [[nodiscard]] std::vector<PointPair> MakePairs(
      const std::vector<std::pair<int, int>>& points) const {
    std::vector<PointPair> pairs(points.size());
    for (size_t i = 0; i < points.size(); ++i) {
      PointPair& p = pairs[i];
      FillSide(a_, points[i].first, keypoints_[i].first, p.in_a, p.xy_a, p.inverse_sigma_a);
      FillSide(b_, points[i].second, keypoints_[i].second, p.in_b, p.xy_b, p.inverse_sigma_b);
    }
    return pairs;
  }

  /// Points of `from` that a keyframe of `to` sees, its pose being known through the similarity.
  [[nodiscard]] Sighting Look(const Neighbourhood& from, const Neighbourhood& to, int keyframe,
                              const Similarity3& from_from_to) const {
    Sighting sighting;
    const Rigid3 pose = TransformCameraPose(from_from_to, to.map.keyframe(keyframe).cam_from_world);
    const FrameFeatures& features = to.map.features(keyframe);
    const FrameView view{&features, &undistorter_, pose};
    for (const int point : from.points) {
      sighting.num_visible += PredictProjection(from.map, from.map.point(point), view).has_value();
    }
    ProjectionSearch search;
    search.radius_px = kSearchRadiusPx;
    search.max_distance = kDescriptorDistance;
    for (const PointMatch& match : MatchByProjection(from.map, from.points, view, {}, search)) {
      const Keypoint& keypoint = features.keypoint(match.keypoint);
      if (SquaredError(undistorter_.intrinsics(), pose, from.map.point(match.point).position,
                       keypoint.undistorted.cast<double>(),
                       1.0 / from.map.sigma(keypoint.level)) <= kChi2) {
        sighting.found.push_back(match);
      }
    }
    return sighting;
  }

  /// Looks for the points of each neighbourhood in the other's keyframe, pairs what both know and
  /// refines the similarity with it. False if too few are left.
  bool SearchAgain(PlaceMatch& match) {
    const Rigid3& pose_a = a_.map.keyframe(a_.keyframe).cam_from_world;
    const Rigid3& pose_b = b_.map.keyframe(b_.keyframe).cam_from_world;
    const auto worlds = [&](const Similarity3& a_from_b) {
      return ToSimilarity(pose_a).Inverse() * a_from_b * ToSimilarity(pose_b);
    };
    const Similarity3 a_from_b_world = worlds(match.a_from_b);
    const Sighting in_b = Look(a_, b_, b_.keyframe, a_from_b_world);
    const Sighting in_a = Look(b_, a_, a_.keyframe, a_from_b_world.Inverse());
    match.found_share = std::min(in_a.FoundShare(), in_b.FoundShare());
    PairPoints(in_a, in_b);
    if (static_cast<int>(points_.size()) < options_.min_pairs) return false;
    const std::vector<PointPair> pairs = MakePairs(points_);
    std::vector<size_t> inliers;
    for (size_t i = 0; i < pairs.size(); ++i) {
      if (SquaredPairError(undistorter_.intrinsics(), match.a_from_b, pairs[i]) <= kChi2) {
        inliers.push_back(i);
      }
    }
    if (static_cast<int>(inliers.size()) < options_.min_pairs) return false;
    const auto refined =
        RefineSimilarity(undistorter_.intrinsics(), pairs, inliers, match.a_from_b);
    if (!refined) return false;
    match.a_from_b = *refined;
    match.world_a_from_world_b = worlds(*refined);
    match.points.clear();
    for (const size_t i : inliers) match.points.push_back(points_[i]);
    return true;
  }

  /// A point of a's neighbourhood at a keypoint of b that has a point of its own is a pair when a's
  /// keyframe sees the former, and the other way round.
  void PairPoints(const Sighting& in_a, const Sighting& in_b) {
    const auto keypoint_of = [](const Neighbourhood& n, int point) {
      for (const MapObservation& o : n.map.point(point).observations) {
        if (o.keyframe == n.keyframe) return o.keypoint;
      }
      return kNoIndex;
    };
    std::vector<std::array<int, 4>> pairs;  // Point a, point b, keypoint a, keypoint b.
    for (const PointMatch& match : in_b.found) {
      const int point_b = b_.map.keyframe(b_.keyframe).point_of_keypoint[match.keypoint];
      const int keypoint_a = keypoint_of(a_, match.point);
      if (point_b == kNoIndex || keypoint_a == kNoIndex) continue;
      pairs.push_back({match.point, point_b, keypoint_a, match.keypoint});
    }
    for (const PointMatch& match : in_a.found) {
      const int point_a = a_.map.keyframe(a_.keyframe).point_of_keypoint[match.keypoint];
      const int keypoint_b = keypoint_of(b_, match.point);
      if (point_a == kNoIndex || keypoint_b == kNoIndex) continue;
      pairs.push_back({point_a, match.point, match.keypoint, keypoint_b});
    }
    std::sort(pairs.begin(), pairs.end());
    points_.clear();
    keypoints_.clear();
    std::vector<int> taken_b;
    for (const auto& [point_a, point_b, keypoint_a, keypoint_b] : pairs) {
      if (!points_.empty() && points_.back().first == point_a) continue;
      if (std::find(taken_b.begin(), taken_b.end(), point_b) != taken_b.end()) continue;
      taken_b.push_back(point_b);
      points_.emplace_back(point_a, point_b);
      keypoints_.emplace_back(keypoint_a, keypoint_b);
    }
  }

  /// Neighbours of `to` that see enough of the points of `from`.
  [[nodiscard]] int Support(const Neighbourhood& from, const Neighbourhood& to,
                            const Similarity3& from_from_to) const {
    int support = 0;
    for (const int neighbour : to.neighbours) {
      const Sighting sighting = Look(from, to, neighbour, from_from_to);
      support += static_cast<int>(sighting.found.size()) >= kMinSupportPoints &&
                 sighting.FoundShare() >= kSupportShare * options_.min_found_share;
    }
    return support;
  }

  const PlaceVerificationOptions& options_;
  const Undistorter& undistorter_;
  Neighbourhood a_;
  Neighbourhood b_;
  std::vector<std::pair<int, int>> points_;     // Of a and of b,
  std::vector<std::pair<int, int>> keypoints_;  // and where their keyframes see them.
};

}  // namespace

void PlaceVerificationOptions::Visit(OptionVisitor& v) {
  v.Value("min_pairs", min_pairs, "points that two views of the same place must have in common", 6,
          10000);
  v.Value("min_found_share", min_found_share,
          "of the points that should be in view, the share that must be found", 0.0, 1.0);
  v.Value("min_support", min_support,
          "neighbouring keyframes, of both views together, that must agree", 0, 100);
  v.Value("neighbours", neighbours, "keyframes around each view that are asked", 1, 100);
}

std::optional<PlaceMatch> VerifyPlace(const PlaceVerificationOptions& options,
                                      const Undistorter& undistorter, const PlaceView& a,
                                      const PlaceView& b) {
  return Verifier(options, undistorter, a, b).Run();
}

}  // namespace s3lam
