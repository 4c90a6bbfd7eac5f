#include "s3lam/slam/submaps.h"

#include <algorithm>
#include <numbers>

#include "s3lam/base/log.h"
#include "s3lam/base/parallel.h"

namespace s3lam {
namespace {

std::vector<uint8_t> TakenFrames(const Submaps& maps, size_t num_frames) {
  std::vector<uint8_t> taken(num_frames, 0);
  for (const auto& map : maps) {
    for (size_t i = 0; i < num_frames; ++i) {
      if (map->tracks()[i].tracked) taken[i] = 1;
    }
  }
  return taken;
}

std::optional<InitialPair> FindPairIn(const InitializerOptions& options,
                                      const std::vector<FrameFeatures>& frames, FrameSpan stretch,
                                      const Undistorter& undistorter, int num_threads) {
  auto pair = FindInitialPair(options,
                              std::span(frames).subspan(static_cast<size_t>(stretch.begin),
                                                        static_cast<size_t>(stretch.Length())),
                              undistorter, num_threads);
  if (!pair) return std::nullopt;
  pair->frame_a += stretch.begin;
  pair->frame_b += stretch.begin;
  return pair;
}

/// No further map is begun from what a complete one has, or from within its initial pair.
void MarkDone(const MapBuilder& builder, std::vector<uint8_t>& is_done) {
  const InitialPair& pair = builder.initial_pair();
  std::fill(is_done.begin() + pair.frame_a, is_done.begin() + pair.frame_b + 1, 1);
  for (size_t i = 0; i < is_done.size(); ++i) {
    if (builder.tracks()[i].tracked) is_done[i] = 1;
  }
}

void SortBySize(Submaps& maps) {
  std::stable_sort(maps.begin(), maps.end(),
                   [](const auto& a, const auto& b) { return a->NumTracked() > b->NumTracked(); });
}

/// Pairs of keyframes of two maps that show the same place.
std::vector<PlaceMatch> FindMeetings(const SubmapOptions& options, const LoopClosingOptions& loops,
                                     const Vocabulary& vocabulary, const Undistorter& undistorter,
                                     int num_threads, const Map& a, const Map& b) {
  PlaceIndex index(vocabulary);
  for (const int k : a.AliveKeyframes()) index.Add(k, vocabulary.Describe(a.features(k)));
  const std::vector<int> keyframes = b.AliveKeyframes();
  std::vector<std::vector<PlaceMatch>> matches(keyframes.size());
  ParallelFor(keyframes.size(), num_threads, [&](size_t i) {
    const BagOfWords words = vocabulary.Describe(b.features(keyframes[i]));
    for (const auto& [similarity, candidate] :
         index.Rank(words, static_cast<size_t>(options.candidates))) {
      const auto match =
          VerifyPlace(loops.verification, undistorter, {&a, candidate}, {&b, keyframes[i]});
      if (match) matches[i].push_back(*match);
    }
  });
  std::vector<PlaceMatch> all;
  for (const auto& of_keyframe : matches) {
    all.insert(all.end(), of_keyframe.begin(), of_keyframe.end());
  }
  return all;
}

/// A keyframe of map b as one meeting with map a puts it into the world of a.
struct PlacedKeyframe {
  Rigid3 cam_from_world_b;
  Rigid3 cam_from_world_a;
  double median_depth = 0.0;  // Of the keyframe of a that it meets.
};

/// Does one meeting of two maps put the one into the other as a second one does, at that one?
bool Agree(const Similarity3& world_a_from_world_b, const PlacedKeyframe& second) {
  constexpr double kMaxRotation = 5.0 * std::numbers::pi / 180.0;
  constexpr double kMaxShift = 0.2;  // Of the median depth.
  const Rigid3 by_first = TransformCameraPose(world_a_from_world_b, second.cam_from_world_b);
  return RotationAngle(by_first.rotation, second.cam_from_world_a.rotation) <= kMaxRotation &&
         (by_first.CenterInB() - second.cam_from_world_a.CenterInB()).norm() <=
             kMaxShift * second.median_depth;
}

/// The meeting that most others agree with, of those the one with the most points; empty if fewer
/// than min_matches, itself among them, agree.
std::optional<PlaceMatch> BestMeeting(const SubmapOptions& options,
                                      const std::vector<PlaceMatch>& meetings, const Map& a,
                                      const Map& b) {
  std::vector<PlacedKeyframe> placed;
  for (const PlaceMatch& meeting : meetings) {
    const Rigid3& camera = b.keyframe(meeting.keyframe_b).cam_from_world;
    placed.push_back({camera, TransformCameraPose(meeting.world_a_from_world_b, camera),
                      a.MedianDepth(meeting.keyframe_a)});
  }
  std::pair<std::ptrdiff_t, size_t> most{0, 0};
  const PlaceMatch* best = nullptr;
  for (const PlaceMatch& meeting : meetings) {
    const auto agreeing =
        std::count_if(placed.begin(), placed.end(), [&](const PlacedKeyframe& keyframe) {
          return Agree(meeting.world_a_from_world_b, keyframe);
        });
    const std::pair<std::ptrdiff_t, size_t> support{agreeing, meeting.points.size()};
    if (best != nullptr && support <= most) continue;
    most = support;
    best = &meeting;
  }
  if (best == nullptr || most.first < options.min_matches) return std::nullopt;
  return *best;
}

/// Tries to put `part` into `whole`.
bool Merge(const SubmapOptions& options, const LoopClosingOptions& loops,
           const Vocabulary& vocabulary, const Undistorter& undistorter, int global_rounds,
           int num_threads, const MapBuilder& part, MapBuilder& whole) {
  const std::vector<PlaceMatch> meetings =
      FindMeetings(options, loops, vocabulary, undistorter, num_threads, whole.map(), part.map());
  std::optional<PlaceMatch> best = BestMeeting(options, meetings, whole.map(), part.map());
  if (!best) return false;
  const MapBuilder::Snapshot before = whole.Keep();
  best->keyframe_b += whole.map().num_keyframes();
  for (auto& [point_a, point_b] : best->points) point_b += whole.map().num_points();
  whole.Absorb(part, best->world_a_from_world_b);
  const Bridge bridge(whole.map(), *best);
  FuseMatch(whole.mapper(), loops.verification.neighbours, *best, whole.map());
  const auto fused = static_cast<double>(whole.map().NumObservations());
  whole.mapper().AdjustGlobally(whole.map(), global_rounds, num_threads);
  const double lost = 1.0 - static_cast<double>(whole.map().NumObservations()) / fused;
  const double surviving = bridge.SurvivingShare(whole.map());
  spdlog::info(
      "two maps meet at {} pairs of keyframes; merging costs {:.2f} % of the observations and "
      "leaves {:.0f} % of the joined points together",
      meetings.size(), 100.0 * lost, 100.0 * surviving);
  if (lost <= loops.max_lost_share && surviving >= loops.min_surviving_share) return true;
  spdlog::warn("maps kept apart: together they contradict each other");
  whole.Restore(before);
  return false;
}

}  // namespace

void SubmapOptions::Visit(OptionVisitor& v) {
  v.Value("min_frames", min_frames, "localised frames that a map of its own must have", 2, 1000000);
  v.Value("min_keyframes", min_keyframes, "keyframes that it must have", 2, 1000000);
  v.Value("candidates", candidates,
          "keyframes of one map that each keyframe of another is compared with", 1, 1000);
  v.Value("min_matches", min_matches,
          "pairs of keyframes at which two maps must meet in the same way", 1, 1000);
}

FrameSpan LongestFree(const std::vector<uint8_t>& is_set) {
  FrameSpan best;
  int begin = 0;
  for (int i = 0; i <= static_cast<int>(is_set.size()); ++i) {
    if (i < static_cast<int>(is_set.size()) && is_set[i] == 0) continue;
    if (i - begin > best.Length()) best = {begin, i};
    begin = i + 1;
  }
  return best;
}

Submaps BuildSubmaps(const SubmapOptions& options, const InitializerOptions& initializer,
                     const std::vector<FrameFeatures>& frames, const Undistorter& undistorter,
                     int num_threads, const MapBuilderFactory& make_builder,
                     const std::function<void()>& after_frame, SubmapsUnderWay& under_way) {
  Submaps& maps = under_way.maps;
  std::vector<uint8_t>& is_done = under_way.is_done;
  is_done.resize(frames.size(), 0);
  while (true) {
    if (under_way.growing == nullptr) {
      const bool is_given = maps.empty() && under_way.start.Length() > 0;
      const FrameSpan free = is_given ? under_way.start : LongestFree(is_done);
      if (free.Length() == 0 || (free.Length() < options.min_frames && !maps.empty())) break;
      const auto pair = FindPairIn(initializer, frames, free, undistorter, num_threads);
      if (!pair && is_given) return {};
      if (!pair) {
        std::fill(is_done.begin() + free.begin, is_done.begin() + free.end, 1);
        continue;
      }
      spdlog::info("map {} starts from frames {} and {}: {} points, parallax {:.1f} deg",
                   maps.size(), pair->frame_a, pair->frame_b, pair->points.size(),
                   pair->parallax_deg);
      under_way.growing = make_builder(TakenFrames(maps, frames.size()));
      under_way.growing->Start(*pair);
    }
    while (under_way.growing->GrowByOne()) after_frame();
    MarkDone(*under_way.growing, is_done);
    maps.push_back(std::move(under_way.growing));
  }
  SortBySize(maps);
  return std::move(maps);
}

int MergeSubmaps(const SubmapOptions& options, const LoopClosingOptions& loops,
                 const Vocabulary& vocabulary, const Undistorter& undistorter, int global_rounds,
                 int num_threads, Submaps& maps) {
  int num_merged = 0;
  for (size_t i = 0; i < maps.size(); ++i) {
    for (size_t j = i + 1; j < maps.size();) {
      if (Merge(options, loops, vocabulary, undistorter, global_rounds, num_threads, *maps[j],
                *maps[i])) {
        maps.erase(maps.begin() + static_cast<std::ptrdiff_t>(j));
        ++num_merged;
        j = i + 1;  // What did not fit before may fit the larger map.
      } else {
        ++j;
      }
    }
  }
  SortBySize(maps);
  const auto is_small = [&](const std::unique_ptr<MapBuilder>& map) {
    return map->NumTracked() < options.min_frames ||
           static_cast<int>(map->map().AliveKeyframes().size()) < options.min_keyframes;
  };
  if (!maps.empty()) {
    maps.erase(std::remove_if(maps.begin() + 1, maps.end(), is_small), maps.end());
  }
  return num_merged;
}

}  // namespace s3lam
