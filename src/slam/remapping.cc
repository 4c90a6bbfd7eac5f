#include "s3lam/slam/remapping.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "s3lam/base/log.h"

namespace s3lam {
namespace {

constexpr int kMinStretch = 10;   // Frames: fewer hardly leave a choice where to start.
constexpr double kNoDoubt = 0.5;  // Below it.
constexpr double kClearlyLess = 2.0 / 3.0;
constexpr int kMinShared = 20;  // Points, for two keyframes to be of one scale and place.

/// The longest first.
std::vector<FrameSpan> StretchesWithoutDoubt(const std::vector<double>& doubts) {
  std::vector<FrameSpan> stretches;
  FrameSpan stretch;
  for (int i = 0; i <= static_cast<int>(doubts.size()); ++i) {
    if (i < static_cast<int>(doubts.size()) && doubts[i] < kNoDoubt) continue;
    stretch.end = i;
    if (stretch.Length() >= kMinStretch) stretches.push_back(stretch);
    stretch.begin = i + 1;
  }
  std::stable_sort(stretches.begin(), stretches.end(),
                   [](const auto& a, const auto& b) { return a.Length() > b.Length(); });
  return stretches;
}

/// Groups that grow together.
class Groups {
 public:
  explicit Groups(size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }

  int Of(int item) {
    while (parent_[item] != item) item = parent_[item] = parent_[parent_[item]];
    return item;
  }
  void Join(int a, int b) { parent_[Of(a)] = Of(b); }

 private:
  std::vector<int> parent_;
};

/// Per frame, 1 - its doubt within the part of the map that most such frames are in, else 0. Beyond
/// keyframes that are refuted a map goes on at any scale, unless others see points on both sides.
std::vector<double> CertaintyInLargestPart(const MapBuilder& builder,
                                           const std::vector<double>& doubts) {
  const Map& map = builder.map();
  const std::vector<int> keyframes = map.KeyframesInTime();
  const auto is_refuted = [&](int k) { return doubts[map.keyframe(k).frame] >= kNoDoubt; };
  Groups parts(static_cast<size_t>(map.num_keyframes()));
  int previous = kNoIndex;
  for (const int k : keyframes) {
    if (!is_refuted(k)) {
      if (previous != kNoIndex && !is_refuted(previous)) parts.Join(previous, k);
      for (const auto& [shared, other] : map.Covisible(k)) {
        if (shared >= kMinShared && !is_refuted(other)) parts.Join(other, k);
      }
    }
    previous = k;
  }
  std::vector<int> part_of_frame(doubts.size(), kNoIndex);
  std::vector<double> size_of_part(static_cast<size_t>(map.num_keyframes()), 0.0);
  size_t next = 0;
  for (size_t i = 0; i < doubts.size(); ++i) {
    while (next + 1 < keyframes.size() &&
           map.keyframe(keyframes[next + 1]).frame <= static_cast<int>(i)) {
      ++next;
    }
    if (!builder.tracks()[i].tracked || keyframes.empty()) continue;
    part_of_frame[i] = parts.Of(keyframes[next]);
    size_of_part[part_of_frame[i]] += 1.0 - doubts[i];
  }
  const auto largest = static_cast<int>(std::max_element(size_of_part.begin(), size_of_part.end()) -
                                        size_of_part.begin());
  std::vector<double> certainty(doubts.size(), 0.0);
  for (size_t i = 0; i < doubts.size(); ++i) {
    if (part_of_frame[i] == largest) certainty[i] = 1.0 - doubts[i];
  }
  return certainty;
}

}  // namespace

void RemappingOptions::Visit(OptionVisitor& v) {
  v.Value("max_attempts", max_attempts, "times the sequence is mapped again; 0 for never", 0, 100);
  v.Value("max_doubt", max_doubt,
          "part of the frames that may be lost, refuted by two views or cut off from the others by "
          "such frames before it is",
          0.0, 1.0);
  v.Value("min_matches", min_matches, "of two views that can refute a map", 8, 10000);
}

std::vector<double> DoubtsOfFrames(const TwoViewCheckOptions& options, const Submaps& maps,
                                   const Undistorter& undistorter, int num_threads,
                                   size_t num_frames) {
  std::vector<double> doubts(num_frames, 1.0);
  for (const auto& map : maps) {
    const std::vector<double> contradictions = ContradictionOfFrames(
        CheckTwoViews(options, map->map(), undistorter, num_threads), num_frames);
    for (size_t i = 0; i < num_frames; ++i) {
      if (map->tracks()[i].tracked) doubts[i] = std::min(doubts[i], Refutation(contradictions[i]));
    }
  }
  return doubts;
}

double PartInDoubt(const Submaps& maps, const std::vector<double>& doubts) {
  std::vector<double> certainty(doubts.size(), 0.0);
  for (const auto& builder : maps) {
    const std::vector<double> in_map = CertaintyInLargestPart(*builder, doubts);
    std::transform(in_map.begin(), in_map.end(), certainty.begin(), certainty.begin(),
                   [](double a, double b) { return std::max(a, b); });
  }
  return 1.0 - std::accumulate(certainty.begin(), certainty.end(), 0.0) /
                   std::max(1.0, static_cast<double>(certainty.size()));
}

RemappingReport MapAgainWhereRefuted(const RemappingOptions& options,
                                     const Undistorter& undistorter, int num_threads,
                                     size_t num_frames, const MapFrom& map_from,
                                     MappedSequence& mapped) {
  RemappingReport report;
  if (options.max_attempts == 0) return report;
  const TwoViewCheckOptions check{.min_matches = options.min_matches, .seed = options.seed};
  const auto doubts_about = [&](const Submaps& maps) {
    return DoubtsOfFrames(check, maps, undistorter, num_threads, num_frames);
  };
  const std::vector<double> doubts = doubts_about(mapped.maps);
  report.doubt_before = report.doubt = PartInDoubt(mapped.maps, doubts);
  for (const FrameSpan& stretch : StretchesWithoutDoubt(doubts)) {
    if (report.doubt <= options.max_doubt || report.attempts == options.max_attempts) break;
    ++report.attempts;
    MappedSequence again = map_from(stretch);
    if (again.maps.empty()) continue;
    const double doubt = PartInDoubt(again.maps, doubts_about(again.maps));
    spdlog::info("{:.0f} % of the frames are in doubt, and {:.0f} % in a map from frames {} to {}",
                 100.0 * report.doubt, 100.0 * doubt, stretch.begin, stretch.end - 1);
    if (doubt > kClearlyLess * report.doubt) continue;
    report.doubt = doubt;
    mapped = std::move(again);
  }
  return report;
}

}  // namespace s3lam
