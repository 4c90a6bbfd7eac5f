#include "s3lam/slam/two_view_check.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <numeric>
#include <optional>

#include "s3lam/base/parallel.h"
#include "s3lam/base/statistics.h"
#include "s3lam/robust/relative_pose.h"
#include "s3lam/slam/matcher.h"

namespace s3lam {
namespace {

/// In keyframes, along the sequence: far enough for what bends to show, near enough for matches.
constexpr std::array<size_t, 3> kSteps{2, 4, 8};
/// Wrong matches that a motion fitted to the matches can always explain: its degrees of freedom.
constexpr int kMotionFreedoms = 5;
constexpr double kChi2 = 3.841;  // 95 %, 1 degree of freedom.
constexpr double kDescriptorRatio = 0.8;
constexpr double kRefutes = 0.04;  // Contradiction that leaves nothing to a map.
constexpr double kRansacThresholdPx = 2.0;
/// Share of matches known to be wrong beyond which the others are not to be believed either.
constexpr double kMaxKnownWrong = 0.07;
constexpr double kApartSigmas = 6.0;  // One corner may be a keypoint on several levels.

/// Does a keyframe see both, at different places?
bool AreSeenApart(const Map& map, int point_a, int point_b) {
  const auto& in_a = map.point(point_a).observations;
  const auto& in_b = map.point(point_b).observations;
  return std::any_of(in_a.begin(), in_a.end(), [&](const MapObservation& a) {
    return std::any_of(in_b.begin(), in_b.end(), [&](const MapObservation& b) {
      if (a.keyframe != b.keyframe) return false;
      const Keypoint& at_a = map.keypoint(a);
      const Keypoint& at_b = map.keypoint(b);
      const double sigma = std::max(map.sigma(at_a.level), map.sigma(at_b.level));
      return (at_a.undistorted - at_b.undistorted).norm() > kApartSigmas * sigma;
    });
  });
}

/// What is burnt into all images, or hangs before the lens, stays where it is in the image while
/// the rest moves, and tells nothing about the motion.
void LeaveOutStill(const FrameFeatures& a, const FrameFeatures& b,
                   std::vector<KeypointMatch>& matches) {
  constexpr double kStillPx = 1.5;
  constexpr double kMovesPx = 8.0;
  if (matches.empty()) return;
  const auto shift = [&](const KeypointMatch& match) -> double {
    return (a.keypoint(match.a).pixel - b.keypoint(match.b).pixel).norm();
  };
  std::vector<double> shifts;
  for (const KeypointMatch& match : matches) shifts.push_back(shift(match));
  if (Median(std::move(shifts)) < kMovesPx) return;
  std::erase_if(matches, [&](const KeypointMatch& match) { return shift(match) < kStillPx; });
}

/// Keypoints of two keyframes that look alike.
class Matches {
 public:
  Matches(const Map& map, const PinholeIntrinsics& camera, int keyframe_a, int keyframe_b) {
    const FrameFeatures& a = map.features(keyframe_a);
    const FrameFeatures& b = map.features(keyframe_b);
    std::vector<KeypointMatch> kept =
        MatchByLooks(a, b, Detected(a), Detected(b), kStrictDescriptorDistance, kDescriptorRatio);
    LeaveOutStill(a, b, kept);
    const double focal = 0.5 * (camera.fx + camera.fy);
    for (const KeypointMatch& match : kept) {
      const Keypoint& in_a = a.keypoint(match.a);
      const Keypoint& in_b = b.keypoint(match.b);
      in_a_.push_back(camera.Normalize(in_a.undistorted.cast<double>()));
      in_b_.push_back(camera.Normalize(in_b.undistorted.cast<double>()));
      sigmas_.push_back(std::max(map.sigma(in_a.level), map.sigma(in_b.level)) / focal);
    }
    threshold_ = kRansacThresholdPx / focal;
    const auto& points_a = map.keyframe(keyframe_a).point_of_keypoint;
    const auto& points_b = map.keyframe(keyframe_b).point_of_keypoint;
    num_known_wrong_ = std::count_if(kept.begin(), kept.end(), [&](const KeypointMatch& match) {
      const int point_a = points_a[match.a];
      const int point_b = points_b[match.b];
      return point_a != kNoIndex && point_b != kNoIndex && point_a != point_b &&
             AreSeenApart(map, point_a, point_b);
    });
  }

  [[nodiscard]] int size() const { return static_cast<int>(sigmas_.size()); }

  /// False where looks deceive, as of windows of one kind in a row: many matches are between
  /// points that are two, which says nothing about the poses in the map.
  [[nodiscard]] bool AreReliable() const {
    return static_cast<double>(num_known_wrong_) <= kMaxKnownWrong * size();
  }

  /// Matches that a motion explains, by their Sampson distance.
  [[nodiscard]] int CountExplained(const Rigid3& b_from_a) const {
    const Eigen::Matrix3d essential =
        CrossMatrix(b_from_a.translation) * b_from_a.rotation.toRotationMatrix();
    int count = 0;
    for (size_t i = 0; i < sigmas_.size(); ++i) {
      const Eigen::Vector3d a = in_a_[i].homogeneous();
      const Eigen::Vector3d b = in_b_[i].homogeneous();
      const Eigen::Vector3d line_b = essential * a;
      const Eigen::Vector3d line_a = essential.transpose() * b;
      const double error = b.dot(line_b);
      const double gradient = line_a.head<2>().squaredNorm() + line_b.head<2>().squaredNorm();
      count += error * error <= kChi2 * sigmas_[i] * sigmas_[i] * gradient ? 1 : 0;
    }
    return count;
  }

  /// The motion that explains the most of them need not be the right one: how many it explains is
  /// all that is asked.
  [[nodiscard]] int CountExplainedByBest(uint64_t seed) const {
    int best = 0;
    for (const Rigid3& motion : RelativePoseCandidates(in_a_, in_b_, threshold_, seed)) {
      best = std::max(best, CountExplained(motion));
    }
    return best;
  }

 private:
  /// Those that were detected in the image, without what the map led to.
  static std::vector<int> Detected(const FrameFeatures& features) {
    std::vector<int> keypoints(static_cast<size_t>(features.num_detected()));
    std::iota(keypoints.begin(), keypoints.end(), 0);
    return keypoints;
  }

  std::vector<Eigen::Vector2d> in_a_;  // Normalised.
  std::vector<Eigen::Vector2d> in_b_;
  std::vector<double> sigmas_;  // Normalised.
  double threshold_ = 0.0;
  std::ptrdiff_t num_known_wrong_ = 0;
};

}  // namespace

void TwoViewCheckOptions::Visit(OptionVisitor& v) {
  v.Value("enabled", enabled, "compare the map with pairs of keyframes matched without it");
  v.Value("min_matches", min_matches, "of a pair that can tell", 8, 10000);
}

double TwoViewCheck::Contradiction() const {
  const int excess = num_of_best - num_of_map - kMotionFreedoms;
  return excess > 0 ? static_cast<double>(excess) / num_of_best : 0.0;
}

std::vector<TwoViewCheck> CheckTwoViews(const TwoViewCheckOptions& options, const Map& map,
                                        const Undistorter& undistorter, int num_threads) {
  if (!options.enabled) return {};
  const std::vector<int> keyframes = map.KeyframesInTime();
  std::vector<std::pair<int, int>> pairs;
  for (size_t i = 0; i < keyframes.size(); ++i) {
    for (const size_t step : kSteps) {
      if (i + step < keyframes.size()) pairs.emplace_back(keyframes[i], keyframes[i + step]);
    }
  }
  std::vector<TwoViewCheck> checks(pairs.size());
  ParallelFor(pairs.size(), num_threads, [&](size_t i) {
    const auto& [a, b] = pairs[i];
    const Matches matches(map, undistorter.intrinsics(), a, b);
    TwoViewCheck& check = checks[i];
    if (matches.size() < options.min_matches || !matches.AreReliable()) return;
    check = {map.keyframe(a).frame, map.keyframe(b).frame, matches.size(), 0, 0};
    check.num_of_map = matches.CountExplained(map.keyframe(b).cam_from_world *
                                              map.keyframe(a).cam_from_world.Inverse());
    check.num_of_best = check.num_of_map;
    // No motion explains more than all: most pairs need no other.
    if (matches.size() - check.num_of_map <= kMotionFreedoms) return;
    check.num_of_best = std::max(check.num_of_best, matches.CountExplainedByBest(options.seed));
  });
  std::erase_if(checks, [](const auto& check) { return check.num_matches == 0; });
  return checks;
}

double Refutation(double contradiction) { return std::min(1.0, contradiction / kRefutes); }

std::vector<double> ContradictionOfFrames(const std::vector<TwoViewCheck>& checks,
                                          size_t num_frames) {
  std::vector<double> contradictions(num_frames, 0.0);
  for (const TwoViewCheck& check : checks) {
    for (int frame = check.frame_a; frame <= check.frame_b; ++frame) {
      double& worst = contradictions[static_cast<size_t>(frame)];
      worst = std::max(worst, check.Contradiction());
    }
  }
  return contradictions;
}

}  // namespace s3lam
