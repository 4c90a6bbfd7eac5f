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

double Mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) /
         std::max(1.0, static_cast<double>(values.size()));
}

}  // namespace

void RemappingOptions::Visit(OptionVisitor& v) {
  v.Value("max_attempts", max_attempts, "times the sequence is mapped again; 0 for never", 0, 100);
  v.Value("max_doubt", max_doubt,
          "part of the frames that may be lost or refuted by two views before it is", 0.0, 1.0);
  v.Value("min_matches", min_matches, "of two views that can refute a map", 8, 10000);
}

std::vector<double> DoubtsOfFrames(int min_matches, const Submaps& maps,
                                   const Undistorter& undistorter, int num_threads,
                                   size_t num_frames) {
  TwoViewCheckOptions options;
  options.min_matches = min_matches;
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

RemappingReport MapAgainWhereRefuted(const RemappingOptions& options,
                                     const Undistorter& undistorter, int num_threads,
                                     size_t num_frames, const MapFrom& map_from,
                                     MappedSequence& mapped) {
  RemappingReport report;
  if (options.max_attempts == 0) return report;
  const auto doubts_about = [&](const Submaps& maps) {
    return DoubtsOfFrames(options.min_matches, maps, undistorter, num_threads, num_frames);
  };
  const std::vector<double> doubts = doubts_about(mapped.maps);
  report.doubt_before = report.doubt = Mean(doubts);
  for (const FrameSpan& stretch : StretchesWithoutDoubt(doubts)) {
    if (report.doubt <= options.max_doubt || report.attempts == options.max_attempts) break;
    ++report.attempts;
    MappedSequence again = map_from(stretch);
    if (again.maps.empty()) continue;
    const double doubt = Mean(doubts_about(again.maps));
    spdlog::info("{:.0f} % of the frames are in doubt, and {:.0f} % in a map from frames {} to {}",
                 100.0 * report.doubt, 100.0 * doubt, stretch.begin, stretch.end - 1);
    if (doubt > kClearlyLess * report.doubt) continue;
    report.doubt = doubt;
    mapped = std::move(again);
  }
  return report;
}

}  // namespace s3lam
