#include "s3lam/slam/initializer.h"

#include <algorithm>
#include <numeric>

#include "pair_evaluator.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/statistics.h"
#include "s3lam/slam/matcher.h"

namespace s3lam {
namespace {

using internal::kMinViewsOfPair;
using internal::kViewsOfPair;
using internal::PairEvaluator;
using internal::Track;

constexpr int kMaxDescriptorDistance = 64;
constexpr double kMaxRatio = 0.9;
constexpr double kSearchRadius = 0.1;   // Of the image's longer side.
constexpr int kMaxMissed = 2;           // Frames in a row that a track may miss.
constexpr double kFirstFlow = 0.03;     // Median flow, of the longer side, that is worth a try.
constexpr double kFlowGrowth = 1.4;     // Between tries.
constexpr double kTrackLoss = 1.4;      // Between tries of a thorough search.
constexpr double kLessParallax = 0.5;   // That a thorough search is content with.
constexpr double kGoodErrorGain = 6.0;  // The depth of a typical track is known to a fifth.
constexpr double kLooksRatio = 0.8;     // Where nothing but looks tells what is matched.
constexpr double kApart = 0.05;         // Flow per frame, of the longer side, for which that is.
constexpr size_t kStartsAtOnce = 8;     // A fixed number, so that threads change nothing.

/// How a search is made, from the one of most sequences to what is left where it finds nothing.
enum class Search {
  kUsual,
  kThorough,  // Tries what is left of the tracks whenever many have ended: on a straight drive what
              // is near and flows much is soon lost.
  kByLooks,   // The same for images far apart: the first step is found without place, and three
              // views do.
};

int MinViews(Search search) { return search == Search::kByLooks ? kMinViewsOfPair : kViewsOfPair; }

std::vector<Track> StartTracks(const FrameFeatures& frame) {
  std::vector<Track> tracks(static_cast<size_t>(frame.size()));
  for (int i = 0; i < frame.size(); ++i) {
    tracks[i].keypoint_of_frame = {i};
    tracks[i].position = frame.keypoint(i).undistorted.cast<double>();
  }
  return tracks;
}

/// Takes tracks on to the keypoints of the next frame, of which each has its track or -1; returns
/// how many were found.
int MoveTracks(const FrameFeatures& next, std::span<const int> track_of_keypoint,
               std::vector<Track>& tracks) {
  for (Track& track : tracks) {
    track.keypoint_of_frame.push_back(-1);
    ++track.missed;
  }
  int found = 0;
  for (int i = 0; i < next.size(); ++i) {
    if (track_of_keypoint[i] < 0) continue;
    Track& track = tracks[track_of_keypoint[i]];
    const Eigen::Vector2d position = next.keypoint(i).undistorted.cast<double>();
    track.velocity = (position - track.position) / track.missed;
    track.position = position;
    track.keypoint_of_frame.back() = i;
    track.missed = 0;
    ++found;
  }
  return found;
}

/// Finds the keypoints of one frame anywhere in the next, and keeps the tracks of those alone.
int BeginTracksByLooks(const FrameFeatures& start, const FrameFeatures& next,
                       std::vector<Track>& tracks) {
  std::vector<int> all_of_start(static_cast<size_t>(start.size()));
  std::vector<int> all_of_next(static_cast<size_t>(next.size()));
  std::iota(all_of_start.begin(), all_of_start.end(), 0);
  std::iota(all_of_next.begin(), all_of_next.end(), 0);
  std::vector<int> track_of_keypoint(static_cast<size_t>(next.size()), -1);
  for (const KeypointMatch& match :
       MatchByLooks(start, next, all_of_start, all_of_next, kMaxDescriptorDistance, kLooksRatio)) {
    track_of_keypoint[match.b] = match.a;
  }
  const int found = MoveTracks(next, track_of_keypoint, tracks);
  std::erase_if(tracks, [](const Track& track) { return track.missed > 0; });
  return found;
}

/// Finds each track in the next frame near where it moves to; returns how many were found.
int ExtendTracks(const FrameFeatures& start, const FrameFeatures& next, double radius,
                 std::vector<Track>& tracks) {
  struct Best {
    int track = -1;
    int distance = 257;
  };
  std::vector<Best> best_of_keypoint(static_cast<size_t>(next.size()));
  for (size_t t = 0; t < tracks.size(); ++t) {
    const Track& track = tracks[t];
    if (track.missed > kMaxMissed) continue;
    const int origin = track.keypoint_of_frame.front();
    const int level = start.keypoint(origin).level;
    Best best;
    int second = 257;
    next.VisitNear(track.position + (track.missed + 1.0) * track.velocity, radius, level - 1,
                   level + 1, [&](int i) {
                     const int d = HammingDistance(start.descriptor(origin), next.descriptor(i));
                     if (d < best.distance) {
                       second = best.distance;
                       best = {i, d};
                     } else {
                       second = std::min(second, d);
                     }
                   });
    if (best.distance > kMaxDescriptorDistance || best.distance > kMaxRatio * second) continue;
    Best& current = best_of_keypoint[best.track];
    if (best.distance < current.distance) current = {static_cast<int>(t), best.distance};
  }
  std::vector<int> track_of_keypoint;
  for (const Best& best : best_of_keypoint) track_of_keypoint.push_back(best.track);
  return MoveTracks(next, track_of_keypoint, tracks);
}

double MedianFlow(const FrameFeatures& start, const std::vector<Track>& tracks) {
  std::vector<double> flows;
  for (const Track& track : tracks) {
    if (track.missed > 0) continue;
    const auto origin = start.keypoint(track.keypoint_of_frame.front()).undistorted.cast<double>();
    flows.push_back((track.position - origin).norm());
  }
  return Median(std::move(flows));
}

double Quality(const InitializerOptions& options, const InitialPair& pair) {
  const double gain = pair.rotation_only_error / pair.mean_squared_error;
  return std::min(1.0, pair.low_parallax_deg / options.good_parallax_deg) *
         std::min(1.0, static_cast<double>(pair.points.size()) / options.good_points) *
         std::min(1.0, gain / kGoodErrorGain);
}

/// The best pair that begins with frame `start`.
std::optional<InitialPair> BestPairFrom(const InitializerOptions& options,
                                        std::span<const FrameFeatures> frames,
                                        const Undistorter& undistorter, int start, Search search) {
  const int end = static_cast<int>(frames.size());
  const bool thorough = search != Search::kUsual;
  const bool by_looks = search == Search::kByLooks;
  const double side = std::max(undistorter.camera().width, undistorter.camera().height);
  PairEvaluator evaluator(options, frames, undistorter);
  std::vector<Track> tracks = StartTracks(frames[start]);
  double next_flow = kFirstFlow * side;
  double next_found = thorough ? static_cast<double>(tracks.size()) : 0.0;
  std::optional<InitialPair> best;
  for (int gap = 1; gap <= options.max_gap && start + gap < end; ++gap) {
    const FrameFeatures& next = frames[start + gap];
    const int found = by_looks && gap == 1
                          ? BeginTracksByLooks(frames[start], next, tracks)
                          : ExtendTracks(frames[start], next, kSearchRadius * side, tracks);
    if (found < options.min_matches) break;
    const double flow = MedianFlow(frames[start], tracks);
    if (by_looks && gap == 1 && flow < kApart * side) break;
    const bool is_last = thorough && (gap == options.max_gap || start + gap + 1 == end);
    const bool is_worth_a_try = flow >= next_flow || found <= next_found || is_last;
    if (gap < MinViews(search) - 1 || !is_worth_a_try) continue;
    if (flow >= next_flow) next_flow = kFlowGrowth * flow;
    if (thorough) next_found = found / kTrackLoss;
    const auto pair = evaluator.Evaluate(start, gap, tracks);
    if (pair && (!best || Quality(options, *pair) > Quality(options, *best))) best = pair;
    if (best && Quality(options, *best) >= 1.0) break;
  }
  return best;
}

/// The best pair of those that begin with frames spread over the sequence.
std::optional<InitialPair> BestPair(const InitializerOptions& options,
                                    std::span<const FrameFeatures> frames,
                                    const Undistorter& undistorter, int num_threads,
                                    Search search) {
  const int end = static_cast<int>(frames.size());
  const int step = std::max(1, end / options.num_starts);
  std::vector<int> starts;
  for (int start = 0; start + MinViews(search) <= end; start += step) starts.push_back(start);
  std::optional<InitialPair> best;
  for (size_t first = 0; first < starts.size(); first += kStartsAtOnce) {
    const size_t count = std::min(kStartsAtOnce, starts.size() - first);
    std::vector<std::optional<InitialPair>> found(count);
    ParallelFor(count, num_threads, [&](size_t i) {
      found[i] = BestPairFrom(options, frames, undistorter, starts[first + i], search);
    });
    for (const auto& pair : found) {
      if (pair && (!best || Quality(options, *pair) > Quality(options, *best))) best = pair;
    }
    if (best && Quality(options, *best) >= 1.0) break;
  }
  return best;
}

}  // namespace

void InitializerOptions::Visit(OptionVisitor& v) {
  v.Value("num_starts", num_starts, "starting frames that are tried, spread over the sequence", 1,
          100000);
  v.Value("max_gap", max_gap, "frames between the two of a pair at the most", 1, 10000);
  v.Value("min_matches", min_matches, "keypoints followed from one frame to the other", 10, 10000);
  v.Value("min_points", min_points, "points that a pair must give", 10, 10000);
  v.Value("min_parallax_deg", min_parallax_deg,
          "median parallax that a pair must have, half of it where none has [deg]", 0.1, 30.0);
  v.Value("good_parallax_deg", good_parallax_deg,
          "parallax that four fifths of the points must have to end the search [deg]", 0.1, 30.0);
  v.Value("good_points", good_points, "points that end the search", 10, 10000);
}

std::optional<InitialPair> FindInitialPair(const InitializerOptions& options,
                                           std::span<const FrameFeatures> frames,
                                           const Undistorter& undistorter, int num_threads) {
  if (auto pair = BestPair(options, frames, undistorter, num_threads, Search::kUsual)) return pair;
  InitializerOptions content = options;
  content.min_parallax_deg *= kLessParallax;
  if (auto pair = BestPair(content, frames, undistorter, num_threads, Search::kThorough)) {
    return pair;
  }
  return BestPair(options, frames, undistorter, num_threads, Search::kByLooks);
}

}  // namespace s3lam
