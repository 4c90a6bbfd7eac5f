#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "s3lam/slam/loop_closer.h"
#include "s3lam/slam/map_builder.h"

namespace s3lam {

struct SubmapOptions {
  int min_frames = 15;
  int min_keyframes = 4;
  int candidates = 3;
  int min_matches = 2;

  void Visit(OptionVisitor& v);
};

/// Maps of the same sequence, each in a world of its own; no frame belongs to two.
using Submaps = std::vector<std::unique_ptr<MapBuilder>>;

/// Makes a MapBuilder; the argument says which frames are taken.
using MapBuilderFactory = std::function<std::unique_ptr<MapBuilder>(std::vector<uint8_t>)>;

/// Frames [begin, end) of a sequence.
struct FrameSpan {
  int begin = 0;
  int end = 0;
  [[nodiscard]] int Length() const { return end - begin; }
};

/// The longest run of frames that are not set; empty if all are.
FrameSpan LongestFree(const std::vector<uint8_t>& is_set);

/// Maps of a sequence on the way.
struct SubmapsUnderWay {
  Submaps maps;                         // Complete ones.
  std::unique_ptr<MapBuilder> growing;  // Null between two maps.
  std::vector<uint8_t> is_done;         // Per frame: localised in those, or tried in vain.
  FrameSpan start;                      // Of the first map; anywhere if empty.
};

/// Builds a map from the best initial pair of the sequence, then others in the stretches that could
/// not be localised in the maps so far, as long as they give one of some size. Empty if no pair of
/// frames, or none within `under_way.start`, gives a map. Goes on from `under_way`, which is empty
/// at the start; `after_frame` is called whenever one more frame is in a map.
Submaps BuildSubmaps(const SubmapOptions& options, const InitializerOptions& initializer,
                     const std::vector<FrameFeatures>& frames, const Undistorter& undistorter,
                     int num_threads, const MapBuilderFactory& make_builder,
                     const std::function<void()>& after_frame, SubmapsUnderWay& under_way);

/// Puts maps together that show the same place: at least min_matches verified pairs of keyframes
/// that agree on how, and a joint map that keeps its observations, as for loops. What is left is in
/// descending order of frames; maps that are too small are dropped, but never the largest. Returns
/// how many merged.
int MergeSubmaps(const SubmapOptions& options, const LoopClosingOptions& loops,
                 const Vocabulary& vocabulary, const Undistorter& undistorter, int global_rounds,
                 int num_threads, Submaps& maps);

}  // namespace s3lam
