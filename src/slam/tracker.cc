#include "s3lam/slam/tracker.h"

#include <algorithm>
#include <array>
#include <numeric>

#include "s3lam/optim/pose_refinement.h"
#include "s3lam/robust/absolute_pose.h"

namespace s3lam {
namespace {

constexpr int kMinFollowed = 20;  // Matches below which the search is widened.
constexpr int kMinPoseInliers = 12;
constexpr int kNeighboursOfKeyframe = 5;
constexpr double kDescriptorRatio = 0.8;
constexpr double kFairShareOfVisible = 0.1;
constexpr double kFairShareOfLast = 0.5;
constexpr double kClearlyBetter = 1.5;     // Ratio of matches.
constexpr double kRecognizedShare = 0.15;  // Of the visible points; chance comes to a tenth.
constexpr double kRansacThresholdPx = 4.0;
constexpr int kCoverageColumns = 8;
constexpr int kCoverageRows = 6;
constexpr int kMinCellKeypoints = 5;  // Fewer say little about what the map lacks there.

/// Keyframes that see the matched points, most first, and the neighbours of the best of them.
std::vector<int> LocalKeyframes(const Map& map, const std::vector<PointMatch>& matches,
                                int max_keyframes) {
  std::vector<int> votes(static_cast<size_t>(map.num_keyframes()), 0);
  for (const PointMatch& match : matches) {
    for (const MapObservation& o : map.point(match.point).observations) ++votes[o.keyframe];
  }
  std::vector<int> keyframes;
  for (int k = 0; k < map.num_keyframes(); ++k) {
    if (votes[k] > 0) keyframes.push_back(k);
  }
  std::stable_sort(keyframes.begin(), keyframes.end(),
                   [&](int a, int b) { return votes[a] > votes[b]; });
  if (static_cast<int>(keyframes.size()) > max_keyframes) {
    keyframes.resize(static_cast<size_t>(max_keyframes));
    return keyframes;
  }
  const size_t num_voted = std::min<size_t>(keyframes.size(), 3);
  for (size_t i = 0; i < num_voted; ++i) {
    int added = 0;
    for (const auto& [shared, neighbour] : map.Covisible(keyframes[i])) {
      if (static_cast<int>(keyframes.size()) >= max_keyframes) return keyframes;
      if (added == kNeighboursOfKeyframe) break;
      if (std::find(keyframes.begin(), keyframes.end(), neighbour) != keyframes.end()) continue;
      keyframes.push_back(neighbour);
      ++added;
    }
  }
  return keyframes;
}

/// Points seen by these keyframes that are not matched yet, ascending.
std::vector<int> LocalPoints(const Map& map, const std::vector<int>& keyframes,
                             const std::vector<PointMatch>& matches) {
  std::vector<uint8_t> seen(static_cast<size_t>(map.num_points()), 0);
  for (const PointMatch& match : matches) seen[match.point] = 1;
  std::vector<int> points;
  for (const int keyframe : keyframes) {
    for (const int point : map.keyframe(keyframe).point_of_keypoint) {
      if (point == kNoIndex || seen[point] != 0) continue;
      seen[point] = 1;
      points.push_back(point);
    }
  }
  std::sort(points.begin(), points.end());
  return points;
}

int MostVoted(const Map& map, const std::vector<PointMatch>& matches) {
  const std::vector<int> keyframes = LocalKeyframes(map, matches, 1);
  return keyframes.empty() ? kNoIndex : keyframes.front();
}

/// Does a frame see a fair share of the points that it should, and of those that the one before it
/// saw? A pose that a few matches fit by chance does not.
bool SeesAsMuch(const FrameTrack& track, const FrameTrack& last) {
  const auto found = static_cast<double>(track.matches.size());
  const double expected = found + static_cast<double>(track.missed.size());
  return found >= kFairShareOfVisible * expected &&
         found >= kFairShareOfLast * static_cast<double>(last.matches.size());
}

}  // namespace

void TrackerOptions::Visit(OptionVisitor& v) {
  v.Value("motion_radius_px", motion_radius_px,
          "search window around where the motion model puts a point, on level 0 [px]", 1.0, 500.0);
  v.Value("map_radius_px", map_radius_px,
          "search window around where a refined pose puts a point, on level 0 [px]", 0.5, 100.0);
  v.Value("min_inliers", min_inliers, "points that a tracked frame must see", 6, 10000);
  v.Value("max_local_keyframes", max_local_keyframes, "keyframes whose points are looked for", 1,
          10000);
  v.Value("keyframe_ratio", keyframe_ratio,
          "a frame that sees a smaller share of its reference keyframe's points becomes a keyframe",
          0.05, 1.0);
  v.Value("min_coverage", min_coverage,
          "a frame becomes a keyframe where the map covers a smaller share of the parts of the "
          "image that have keypoints",
          0.0, 1.0);
  v.Value("max_keyframe_gap", max_keyframe_gap, "frames between keyframes at the most", 1, 100000);
}

Rigid3 CurrentPose(const Map& map, const FrameTrack& track) {
  if (track.reference_keyframe == kNoIndex) return track.cam_from_world;
  return track.cam_from_reference * map.PoseOf(track.reference_keyframe);
}

std::vector<PointMatch> Tracker::FollowMatches(const Map& map, int frame, const FrameTrack& last,
                                               const Rigid3& predicted, double radius_px) const {
  std::vector<int> points;
  for (const PointMatch& match : last.matches) {
    const int point = map.Resolve(match.point);
    if (point != kNoIndex) points.push_back(point);
  }
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  ProjectionSearch search;
  search.radius_px = radius_px;
  search.max_ratio = 1.0;
  return MatchByProjection(map, points, {&map.frame(frame), &undistorter_, predicted}, {}, search);
}

int Tracker::Refine(const Map& map, int frame, Rigid3& cam_from_world,
                    std::vector<PointMatch>& matches) const {
  std::vector<PoseObservation> observations;
  observations.reserve(matches.size());
  const FrameFeatures& features = map.frame(frame);
  for (const PointMatch& match : matches) {
    const Keypoint& keypoint = features.keypoint(match.keypoint);
    observations.push_back({map.point(match.point).position, keypoint.undistorted.cast<double>(),
                            1.0 / keypoint.sigma});
  }
  const PoseRefinementResult result =
      RefinePose(undistorter_.intrinsics(), observations, cam_from_world);
  std::vector<PointMatch> inliers;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (result.is_inlier[i] != 0) inliers.push_back(matches[i]);
  }
  matches.swap(inliers);
  return result.num_inliers;
}

std::optional<std::pair<Rigid3, std::vector<PointMatch>>> Tracker::FindByDescriptors(
    const Map& map, int frame, int keyframe) const {
  const FrameFeatures& features = map.frame(frame);
  const FrameFeatures& keyframe_features = map.features(keyframe);
  const std::vector<int>& points = map.keyframe(keyframe).point_of_keypoint;
  std::vector<int> with_point;
  for (int i = 0; i < keyframe_features.size(); ++i) {
    if (points[i] != kNoIndex) with_point.push_back(i);
  }
  std::vector<int> all(static_cast<size_t>(features.size()));
  std::iota(all.begin(), all.end(), 0);
  std::vector<PointMatch> matches;
  for (const KeypointMatch& pair : MatchByLooks(keyframe_features, features, with_point, all,
                                                kStrictDescriptorDistance + 14, kDescriptorRatio)) {
    matches.push_back({pair.b, points[pair.a]});
  }
  if (static_cast<int>(matches.size()) < kMinPoseInliers) return std::nullopt;
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector2d> normalized;
  const PinholeIntrinsics& camera = undistorter_.intrinsics();
  for (const PointMatch& match : matches) {
    positions.push_back(map.point(match.point).position);
    normalized.push_back(
        camera.Normalize(features.keypoint(match.keypoint).undistorted.cast<double>()));
  }
  const double threshold = kRansacThresholdPx / (0.5 * (camera.fx + camera.fy));
  const auto pose = EstimateAbsolutePose(positions, normalized, threshold, options_.seed);
  if (!pose || pose->num_inliers < kMinPoseInliers) return std::nullopt;
  std::vector<PointMatch> inliers;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (pose->is_inlier[i] != 0) inliers.push_back(matches[i]);
  }
  return std::pair(pose->cam_from_world, std::move(inliers));
}

FrameTrack Tracker::Track(const Map& map, int frame, const FrameTrack& last,
                          const Rigid3& predicted) const {
  FrameTrack near = TrackNear(map, frame, last, predicted);
  if (near.tracked && SeesAsMuch(near, last)) return near;
  const int keyframe = last.reference_keyframe;
  if (keyframe == kNoIndex || !map.keyframe(keyframe).alive) return near;
  auto found = FindByDescriptors(map, frame, keyframe);
  if (!found) return near;
  auto& [pose, matches] = *found;
  if (Refine(map, frame, pose, matches) < kMinPoseInliers) return near;
  FrameTrack track = TrackLocalMap(map, frame, pose, matches, options_.map_radius_px);
  const double margin = near.tracked ? kClearlyBetter : 1.0;
  const bool is_better =
      static_cast<double>(track.matches.size()) > margin * static_cast<double>(near.matches.size());
  return is_better ? track : near;
}

FrameTrack Tracker::TrackNear(const Map& map, int frame, const FrameTrack& near,
                              const Rigid3& guess) const {
  FrameTrack best;
  for (const double factor : {1.0, 2.5}) {
    Rigid3 pose = guess;
    std::vector<PointMatch> matches =
        FollowMatches(map, frame, near, guess, factor * options_.motion_radius_px);
    if (static_cast<int>(matches.size()) < kMinFollowed) continue;
    if (Refine(map, frame, pose, matches) < kMinFollowed) continue;
    FrameTrack track = TrackLocalMap(map, frame, pose, matches, options_.map_radius_px);
    if (track.matches.size() > best.matches.size()) best = std::move(track);
    if (best.tracked) break;
  }
  return best;
}

FrameTrack Tracker::Relocalize(const Map& map, int frame, int keyframe) const {
  auto found = FindByDescriptors(map, frame, keyframe);
  if (!found) return {};
  auto& [pose, matches] = *found;
  if (Refine(map, frame, pose, matches) < kMinPoseInliers) return {};
  const FrameTrack wide = TrackLocalMap(map, frame, pose, matches, 3.0 * options_.map_radius_px);
  if (!wide.tracked) return {};
  const FrameTrack track =
      TrackLocalMap(map, frame, wide.cam_from_world, wide.matches, options_.map_radius_px);
  // A place found by looks alone must convince more than one that motion led to. Among two thousand
  // points of a similar place, a hundred are found by chance.
  const bool enough = static_cast<int>(track.matches.size()) >= 2 * options_.min_inliers;
  const double num_visible = static_cast<double>(track.matches.size() + track.missed.size());
  const double found_share = static_cast<double>(track.matches.size()) / num_visible;
  return enough && found_share >= kRecognizedShare ? track : FrameTrack{};
}

FrameTrack Tracker::TrackLocalMap(const Map& map, int frame, const Rigid3& cam_from_world,
                                  const std::vector<PointMatch>& matches, double radius_px) const {
  FrameTrack track;
  track.cam_from_world = cam_from_world;
  track.matches = matches;
  const FrameFeatures& features = map.frame(frame);
  const std::vector<int> points =
      LocalPoints(map, LocalKeyframes(map, matches, options_.max_local_keyframes), matches);
  std::vector<uint8_t> taken(static_cast<size_t>(features.size()), 0);
  for (const PointMatch& match : matches) taken[match.keypoint] = 1;
  ProjectionSearch search;
  search.radius_px = radius_px;
  search.max_ratio = 0.8;
  const FrameView view{&features, &undistorter_, cam_from_world};
  const std::vector<PointMatch> more = MatchByProjection(map, points, view, taken, search);
  track.matches.insert(track.matches.end(), more.begin(), more.end());
  Refine(map, frame, track.cam_from_world, track.matches);
  std::vector<uint8_t> found(static_cast<size_t>(map.num_points()), 0);
  for (const PointMatch& match : track.matches) found[match.point] = 1;
  for (const int point : points) {
    if (found[point] == 0 && PredictProjection(map, map.point(point), view)) {
      track.missed.push_back(point);
    }
  }
  for (const PointMatch& match : matches) {
    if (found[match.point] == 0) track.missed.push_back(match.point);
  }
  track.tracked = static_cast<int>(track.matches.size()) >= options_.min_inliers;
  track.reference_keyframe = MostVoted(map, track.matches);
  if (track.reference_keyframe == kNoIndex) return {};
  track.cam_from_reference =
      track.cam_from_world * map.keyframe(track.reference_keyframe).cam_from_world.Inverse();
  return track;
}

double Tracker::Coverage(const FrameFeatures& features,
                         const std::vector<PointMatch>& matches) const {
  std::array<int, kCoverageColumns * kCoverageRows> keypoints{};
  std::array<bool, kCoverageColumns * kCoverageRows> matched{};
  const auto cell_of = [&](int keypoint) {
    return undistorter_.CellOf(features.keypoint(keypoint), kCoverageColumns, kCoverageRows);
  };
  for (int i = 0; i < features.size(); ++i) ++keypoints[cell_of(i)];
  for (const PointMatch& match : matches) matched[cell_of(match.keypoint)] = true;
  int textured = 0;
  int covered = 0;
  for (size_t cell = 0; cell < keypoints.size(); ++cell) {
    if (keypoints[cell] < kMinCellKeypoints) continue;
    ++textured;
    covered += matched[cell] ? 1 : 0;
  }
  return textured > 0 ? static_cast<double>(covered) / textured : 1.0;
}

bool Tracker::NeedsKeyframe(const Map& map, int frame, const FrameTrack& track,
                            int frames_since_keyframe) const {
  if (frames_since_keyframe >= options_.max_keyframe_gap) return true;
  if (Coverage(map.frame(frame), track.matches) < options_.min_coverage) return true;
  const int min_observations = map.num_keyframes() > 2 ? 3 : 2;
  const int of_reference = map.CountPoints(track.reference_keyframe, min_observations);
  return static_cast<double>(track.matches.size()) < options_.keyframe_ratio * of_reference;
}

}  // namespace s3lam
