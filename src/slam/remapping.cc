#include "s3lam/slam/remapping.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "s3lam/base/log.h"

namespace s3lam {
namespace {

constexpr int kMinStretch = 10;  // Frames: fewer hardly leave a choice where to start.
constexpr double kClearlyLess = 2.0 / 3.0;
constexpr int kMinShared = 20;  // Points, for two keyframes to be of one scale and place.

/// About the maps of a sequence.
struct Doubts {
  std::vector<double> of_frames;
  double part = 0.0;
};

/// Where in the sequence maps are begun, none twice.
class Starts {
 public:
  /// But for the pairs that these maps were begun from: from those the same would come of it.
  Starts(const Submaps& maps, size_t num_frames) : is_tried_(num_frames, 0) {
    for (const auto& map : maps) {
      const InitialPair& pair = map->initial_pair();
      if (pair.frame_a >= 0) Mark({pair.frame_a, pair.frame_b + 1});
    }
  }

  /// The longest stretch without doubt, or of any frames if there is none, that is left; empty if
  /// none is.
  FrameSpan Next(const std::vector<double>& doubts) {
    std::vector<uint8_t> is_barred = is_tried_;
    for (size_t i = 0; i < doubts.size(); ++i) {
      if (doubts[i] >= kRefuted) is_barred[i] = 1;
    }
    FrameSpan start = LongestFree(is_barred);
    if (start.Length() < kMinStretch) start = LongestFree(is_tried_);
    if (start.Length() < kMinStretch) return {};
    Mark(start);
    return start;
  }

 private:
  void Mark(const FrameSpan& span) {
    std::fill(is_tried_.begin() + span.begin, is_tried_.begin() + span.end, 1);
  }

  std::vector<uint8_t> is_tried_;  // Per frame.
};

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

/// Per frame, 1 - its doubt within the largest part of the map, else 0.
std::vector<double> CertaintyInLargestPart(const MapBuilder& builder,
                                           const std::vector<double>& doubts) {
  const MapParts parts = FindParts(builder.map(), builder.tracks(), doubts);
  std::vector<double> certainty(doubts.size(), 0.0);
  for (size_t i = 0; i < doubts.size(); ++i) {
    if (parts.of_frame[i] == parts.largest) certainty[i] = 1.0 - doubts[i];
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

MapParts FindParts(const Map& map, const std::vector<FrameTrack>& tracks,
                   const std::vector<double>& doubts) {
  const std::vector<int> keyframes = map.KeyframesInTime();
  const auto is_refuted = [&](int k) { return doubts[map.keyframe(k).frame] >= kRefuted; };
  Groups groups(static_cast<size_t>(map.num_keyframes()));
  int previous = kNoIndex;
  for (const int k : keyframes) {
    if (!is_refuted(k)) {
      if (previous != kNoIndex && !is_refuted(previous)) groups.Join(previous, k);
      for (const auto& [shared, other] : map.Covisible(k)) {
        if (shared >= kMinShared && !is_refuted(other)) groups.Join(other, k);
      }
    }
    previous = k;
  }
  MapParts parts;
  parts.of_frame.assign(doubts.size(), kNoIndex);
  std::vector<double> certainty(static_cast<size_t>(map.num_keyframes()), 0.0);
  size_t next = 0;
  for (size_t i = 0; i < doubts.size(); ++i) {
    while (next + 1 < keyframes.size() &&
           map.keyframe(keyframes[next + 1]).frame <= static_cast<int>(i)) {
      ++next;
    }
    if (!tracks[i].tracked || keyframes.empty()) continue;
    parts.of_frame[i] = groups.Of(keyframes[next]);
    certainty[parts.of_frame[i]] += 1.0 - doubts[i];
  }
  parts.largest =
      static_cast<int>(std::max_element(certainty.begin(), certainty.end()) - certainty.begin());
  return parts;
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
                                     MappedSequence& mapped, const CloseLoopsIn& close_loops) {
  RemappingReport report;
  if (options.max_attempts == 0) return report;
  const TwoViewCheckOptions check{.min_matches = options.min_matches, .seed = options.seed};
  const auto doubts_about = [&](const Submaps& maps) {
    Doubts doubts{DoubtsOfFrames(check, maps, undistorter, num_threads, num_frames), 0.0};
    doubts.part = PartInDoubt(maps, doubts.of_frames);
    return doubts;
  };
  const auto close_if_in_doubt = [&](MappedSequence& sequence, Doubts& doubts) {
    if (doubts.part <= options.max_doubt || !close_loops) return;
    close_loops(sequence);
    doubts = doubts_about(sequence.maps);
  };
  Doubts doubts = doubts_about(mapped.maps);
  report.doubt_before = doubts.part;
  close_if_in_doubt(mapped, doubts);
  Starts starts(mapped.maps, num_frames);
  while (doubts.part > options.max_doubt && report.attempts < options.max_attempts) {
    const FrameSpan start = starts.Next(doubts.of_frames);
    if (start.Length() == 0) break;
    ++report.attempts;
    MappedSequence again = map_from(start);
    if (again.maps.empty()) continue;
    Doubts doubts_again = doubts_about(again.maps);
    close_if_in_doubt(again, doubts_again);
    spdlog::info("{:.0f} % of the frames are in doubt, and {:.0f} % in a map from frames {} to {}",
                 100.0 * doubts.part, 100.0 * doubts_again.part, start.begin, start.end - 1);
    if (doubts_again.part > kClearlyLess * doubts.part) continue;
    doubts = std::move(doubts_again);
    mapped = std::move(again);
  }
  report.doubt = doubts.part;
  return report;
}

}  // namespace s3lam
