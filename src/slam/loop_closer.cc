#include "s3lam/slam/loop_closer.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "s3lam/base/log.h"
#include "s3lam/base/parallel.h"
#include "s3lam/optim/pose_graph.h"

namespace s3lam {
namespace {

constexpr int kMinSharedForEdge = 15;
constexpr int kEdgesOfKeyframe = 10;
/// Points that weigh as much as one unit of a pose graph's edge.
constexpr double kPointsOfUnitWeight = 100.0;

double EdgeWeight(int num_points) { return std::sqrt(num_points / kPointsOfUnitWeight); }

/// Keyframes that share points with this one, or with one that does.
std::vector<uint8_t> Connected(const Map& map, int keyframe) {
  std::vector<uint8_t> connected(static_cast<size_t>(map.num_keyframes()), 0);
  connected[keyframe] = 1;
  for (const auto& [shared, near] : map.Covisible(keyframe)) {
    connected[near] = 1;
    if (shared < kMinSharedForEdge) continue;
    for (const auto& [shared_next, next] : map.Covisible(near)) {
      if (shared_next >= kMinSharedForEdge) connected[next] = 1;
    }
  }
  return connected;
}

/// Every keyframe against those that look most like it, nearby ones aside.
std::vector<PlaceMatch> FindLoops(const LoopClosingOptions& options, const Vocabulary& vocabulary,
                                  const Undistorter& undistorter, int num_threads, const Map& map) {
  const std::vector<int> keyframes = map.AliveKeyframes();
  std::vector<BagOfWords> bags(keyframes.size());
  ParallelFor(keyframes.size(), num_threads,
              [&](size_t i) { bags[i] = vocabulary.Describe(map.features(keyframes[i])); });
  PlaceIndex index(vocabulary);
  for (size_t i = 0; i < keyframes.size(); ++i) index.Add(keyframes[i], bags[i]);
  std::vector<std::vector<PlaceMatch>> matches(keyframes.size());
  ParallelFor(keyframes.size(), num_threads, [&](size_t i) {
    const int keyframe = keyframes[i];
    std::vector<uint8_t> skip = Connected(map, keyframe);
    // Earlier frames only, so that no pair comes up twice.
    for (const int other : keyframes) {
      const int gap = map.keyframe(keyframe).frame - map.keyframe(other).frame;
      if (gap < options.min_frame_gap) skip[other] = 1;
    }
    const auto ranked = index.Rank(bags[i], static_cast<size_t>(options.candidates), skip);
    for (const auto& [similarity, other] : ranked) {
      const auto match =
          VerifyPlace(options.verification, undistorter, {&map, other}, {&map, keyframe});
      if (match) matches[i].push_back(*match);
    }
  });
  std::vector<PlaceMatch> all;
  for (const auto& of_keyframe : matches)
    all.insert(all.end(), of_keyframe.begin(), of_keyframe.end());
  return all;
}

/// The map's own edges and the loops'.
PoseGraph MakeGraph(const Map& map, const std::vector<int>& keyframes,
                    const std::vector<PlaceMatch>& loops) {
  PoseGraph graph;
  std::vector<int> node_of_keyframe(static_cast<size_t>(map.num_keyframes()), kNoIndex);
  for (const int k : keyframes) {
    node_of_keyframe[k] = static_cast<int>(graph.nodes.size());
    graph.nodes.push_back(ToSimilarity(map.keyframe(k).cam_from_world));
  }
  const auto add = [&](int a, int b, const Similarity3& a_from_b, int num_points) {
    graph.edges.push_back({node_of_keyframe[a], node_of_keyframe[b], a_from_b,
                           std::max(map.MedianDepth(a), 1e-9), EdgeWeight(num_points)});
  };
  for (const int a : keyframes) {
    int count = 0;
    for (const auto& [shared, b] : map.Covisible(a)) {
      if (count == kEdgesOfKeyframe || (count > 0 && shared < kMinSharedForEdge)) break;
      ++count;
      const Rigid3 a_from_b =
          map.keyframe(a).cam_from_world * map.keyframe(b).cam_from_world.Inverse();
      add(a, b, ToSimilarity(a_from_b), shared);
    }
  }
  for (const PlaceMatch& loop : loops) {
    add(loop.keyframe_a, loop.keyframe_b, loop.a_from_b, static_cast<int>(loop.points.size()));
  }
  return graph;
}

/// Moves keyframes, what hangs on them, and each point with the first keyframe that sees it.
void ApplyGraph(const PoseGraph& graph, const std::vector<int>& keyframes, Map& map,
                std::vector<FrameTrack>& tracks) {
  std::vector<Similarity3> node(static_cast<size_t>(map.num_keyframes()));
  std::vector<Rigid3> old_pose(static_cast<size_t>(map.num_keyframes()));
  for (size_t i = 0; i < keyframes.size(); ++i) {
    const int k = keyframes[i];
    node[k] = graph.nodes[i];
    old_pose[k] = map.keyframe(k).cam_from_world;
    map.SetPose(k, {node[k].rotation, node[k].translation / node[k].scale});
  }
  for (int p = 0; p < map.num_points(); ++p) {
    if (!map.point(p).alive) continue;
    const int k = map.point(p).observations.front().keyframe;
    map.SetPosition(p, node[k].Inverse() * (old_pose[k] * map.point(p).position));
  }
  for (int p = 0; p < map.num_points(); ++p) {
    if (map.point(p).alive) map.UpdateGeometry(p);
  }
  for (int k = 0; k < map.num_keyframes(); ++k) {
    if (!map.keyframe(k).alive) map.ScaleAnchored(k, 1.0 / node[map.AnchorOf(k)].scale);
  }
  for (FrameTrack& track : tracks) {
    if (track.reference_keyframe == kNoIndex) continue;
    track.cam_from_reference.translation /= node[map.AnchorOf(track.reference_keyframe)].scale;
  }
}

LoopReport Describe(const Map& map, const PlaceMatch& loop) {
  const Rigid3 estimate = map.keyframe(loop.keyframe_a).cam_from_world *
                          map.keyframe(loop.keyframe_b).cam_from_world.Inverse();
  LoopReport report;
  report.frame_a = map.keyframe(loop.keyframe_a).frame;
  report.frame_b = map.keyframe(loop.keyframe_b).frame;
  report.num_points = static_cast<int>(loop.points.size());
  report.correction_deg =
      RotationAngle(estimate.rotation, loop.a_from_b.rotation) * 180.0 / std::numbers::pi;
  report.correction_share = (estimate.translation - loop.a_from_b.translation).norm() /
                            std::max(map.MedianDepth(loop.keyframe_a), 1e-9);
  report.correction_scale = loop.a_from_b.scale;
  return report;
}

/// Closes loops and looks whether the map bears it.
class LoopTrial {
 public:
  LoopTrial(const LoopClosingOptions& options, const Mapper& mapper, int global_rounds,
            int num_threads, Map& map, std::vector<FrameTrack>& tracks)
      : options_(options),
        mapper_(mapper),
        global_rounds_(global_rounds),
        num_threads_(num_threads),
        map_(map),
        tracks_(tracks) {}

  /// Closes all loops, or, if the map contradicts them, those that were not torn; `loops` are the
  /// closed ones then. Without any, the map stays as it is.
  std::vector<LoopReport> CloseWhatHolds(std::vector<PlaceMatch>& loops) {
    for (int attempt = 0; attempt < kMaxTrials && !loops.empty(); ++attempt) {
      std::vector<LoopReport> reports;
      for (const PlaceMatch& loop : loops) reports.push_back(Describe(map_, loop));
      const Map before = map_;
      const std::vector<FrameTrack> tracks_before = tracks_;
      if (!Close(loops)) break;
      if (lost_share_ <= options_.max_lost_share && NumTorn() == 0) return reports;
      spdlog::warn("{} loops undone: the map contradicts them", loops.size());
      map_ = before;
      tracks_ = tracks_before;
      if (NumTorn() == 0) break;
      std::vector<PlaceMatch> held;
      for (size_t i = 0; i < loops.size(); ++i) {
        if (!IsTorn(i)) held.push_back(std::move(loops[i]));
      }
      loops.swap(held);
    }
    loops.clear();
    return {};
  }

 private:
  static constexpr int kMaxTrials = 3;

  /// False if the pose graph cannot be solved; then the map is as it was.
  bool Close(const std::vector<PlaceMatch>& loops) {
    const std::vector<int> keyframes = map_.AliveKeyframes();
    PoseGraph graph = MakeGraph(map_, keyframes, loops);
    if (!OptimizePoseGraph(graph).usable) return false;
    std::vector<Bridge> bridges;
    for (const PlaceMatch& loop : loops) bridges.emplace_back(map_, loop);
    ApplyGraph(graph, keyframes, map_, tracks_);
    for (const PlaceMatch& loop : loops) {
      FuseMatch(mapper_, options_.verification.neighbours, loop, map_);
    }
    const auto fused = static_cast<double>(map_.NumObservations());
    mapper_.AdjustGlobally(map_, global_rounds_, num_threads_);
    lost_share_ = 1.0 - static_cast<double>(map_.NumObservations()) / fused;
    surviving_shares_.clear();
    for (const Bridge& bridge : bridges) surviving_shares_.push_back(bridge.SurvivingShare(map_));
    spdlog::info(
        "{} places seen again; closing the loops costs {:.2f} % of the observations and tears {} "
        "of them",
        loops.size(), 100.0 * lost_share_, NumTorn());
    return true;
  }

  [[nodiscard]] bool IsTorn(size_t loop) const {
    return surviving_shares_[loop] < options_.min_surviving_share;
  }
  [[nodiscard]] size_t NumTorn() const {
    size_t count = 0;
    for (size_t i = 0; i < surviving_shares_.size(); ++i) count += IsTorn(i) ? 1 : 0;
    return count;
  }

  const LoopClosingOptions& options_;
  const Mapper& mapper_;
  int global_rounds_;
  int num_threads_;
  Map& map_;
  std::vector<FrameTrack>& tracks_;
  double lost_share_ = 0.0;
  std::vector<double> surviving_shares_;  // Per loop.
};

bool HaveCommon(const std::vector<MapObservation>& observations, const std::vector<int>& sorted) {
  return std::any_of(observations.begin(), observations.end(), [&](const MapObservation& o) {
    return std::binary_search(sorted.begin(), sorted.end(), o.keyframe);
  });
}

}  // namespace

void LoopClosingOptions::Visit(OptionVisitor& v) {
  v.Value("enabled", enabled, "look for places seen before and close the loops");
  v.Value("candidates", candidates, "similar keyframes that each is compared with", 1, 1000);
  v.Value("min_frame_gap", min_frame_gap, "frames between the two ends of a loop at the least", 1,
          1000000);
  v.Value("max_rounds", max_rounds, "of looking for loops in the map as closed so far", 1, 100);
  v.Value("max_lost_share", max_lost_share,
          "share of its observations that the map may lose when a loop is closed", 0.0, 1.0);
  v.Value("min_surviving_share", min_surviving_share,
          "share of the points joined by a loop, or by the meeting of two maps, that must still be "
          "seen from both sides after the adjustment",
          0.0, 1.0);
  v.Group("verification", verification, "when two keyframes are held to show the same place");
}

Bridge::Bridge(const Map& map, const PlaceMatch& match) {
  const auto observers = [&](int point) {
    std::vector<int> keyframes;
    for (const MapObservation& o : map.point(point).observations) keyframes.push_back(o.keyframe);
    return keyframes;
  };
  for (const auto& [a, b] : match.points) pairs_.push_back({a, b, observers(a), observers(b)});
}

double Bridge::SurvivingShare(const Map& map) const {
  if (pairs_.empty()) return 0.0;
  const auto count = std::count_if(pairs_.begin(), pairs_.end(), [&](const Pair& pair) {
    const int point = map.Resolve(pair.point_a);
    if (point == kNoIndex || point != map.Resolve(pair.point_b)) return false;
    const auto& observations = map.point(point).observations;
    return HaveCommon(observations, pair.observers_a) && HaveCommon(observations, pair.observers_b);
  });
  return static_cast<double>(count) / static_cast<double>(pairs_.size());
}

void FuseMatch(const Mapper& mapper, int neighbours, const PlaceMatch& match, Map& map) {
  for (const auto& [a, b] : match.points) {
    const int point_a = map.Resolve(a);
    const int point_b = map.Resolve(b);
    if (point_a == kNoIndex || point_b == kNoIndex || point_a == point_b) continue;
    map.MergePoints(point_a, point_b);
  }
  const auto around = [&](int keyframe) {
    std::vector<int> keyframes{keyframe};
    for (const auto& [shared, other] : map.Covisible(keyframe)) {
      if (static_cast<int>(keyframes.size()) > neighbours) break;
      keyframes.push_back(other);
    }
    return keyframes;
  };
  const std::vector<int> around_a = around(match.keyframe_a);
  const std::vector<int> around_b = around(match.keyframe_b);
  const std::vector<int> points_a = PointsOf(map, around_a);
  for (const int keyframe : around_b) mapper.FuseInto(map, points_a, keyframe);
  const std::vector<int> points_b = PointsOf(map, around_b);
  for (const int keyframe : around_a) mapper.FuseInto(map, points_b, keyframe);
}

LoopClosingReport CloseLoops(const LoopClosingOptions& options, const Vocabulary& vocabulary,
                             const Undistorter& undistorter, const Mapper& mapper,
                             int global_rounds, int num_threads, Map& map,
                             std::vector<FrameTrack>& tracks) {
  LoopClosingReport report;
  if (!options.enabled) return report;
  std::set<std::pair<int, int>> rejected;
  for (int round = 0; round < options.max_rounds; ++round) {
    std::vector<PlaceMatch> loops = FindLoops(options, vocabulary, undistorter, num_threads, map);
    std::erase_if(loops, [&](const PlaceMatch& loop) {
      return rejected.contains({loop.keyframe_a, loop.keyframe_b});
    });
    std::set<std::pair<int, int>> tried;
    for (const PlaceMatch& loop : loops) tried.emplace(loop.keyframe_a, loop.keyframe_b);
    LoopTrial trial(options, mapper, global_rounds, num_threads, map, tracks);
    const std::vector<LoopReport> closed = trial.CloseWhatHolds(loops);
    report.num_rejected += static_cast<int>(tried.size() - closed.size());
    report.closed.insert(report.closed.end(), closed.begin(), closed.end());
    if (closed.empty()) break;
    for (const PlaceMatch& loop : loops) tried.erase({loop.keyframe_a, loop.keyframe_b});
    rejected.merge(tried);
  }
  return report;
}

}  // namespace s3lam
