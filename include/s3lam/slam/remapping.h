#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/slam/submaps.h"
#include "s3lam/slam/two_view_check.h"

namespace s3lam {

struct RemappingOptions {
  int max_attempts = 2;
  double max_doubt = 0.05;
  int min_matches = 100;
  uint64_t seed = 0;  // Of the samples drawn; from the command line.

  void Visit(OptionVisitor& v);
};

/// All maps of a sequence, merged where they meet and adjusted.
struct MappedSequence {
  Submaps maps;
  int num_merged = 0;
  std::vector<LoopClosingReport> loops;  // Per map, if they are closed; else empty.
};

struct RemappingReport {
  int attempts = 0;           // Times the sequence was mapped again.
  double doubt_before = 0.0;  // PartInDoubt of the maps as they were, before loops were closed,
  double doubt = 0.0;         // and of those that stayed.
};

/// Maps a sequence, the first map from an initial pair within the given frames; empty if there is
/// none.
using MapFrom = std::function<MappedSequence(const FrameSpan& start)>;

/// Closes the loops in all maps of a sequence.
using CloseLoopsIn = std::function<void(MappedSequence&)>;

/// Per frame, in [0, 1]: 1 where it is in no map or its map is refuted by pairs of keyframes around
/// it, see Refutation. Few matches, between views far apart, refute the exactness of a map; that it
/// is wrong is said by pairs with at least RemappingOptions' `min_matches`.
std::vector<double> DoubtsOfFrames(const TwoViewCheckOptions& options, const Submaps& maps,
                                   const Undistorter& undistorter, int num_threads,
                                   size_t num_frames);

/// What of a map hangs together: beyond keyframes that are refuted it goes on at any place and
/// scale, unless others see points on both sides.
struct MapParts {
  std::vector<int> of_frame;  // kNoIndex where a frame is not in the map.
  int largest = kNoIndex;     // The part with the most frames, by their certainty.
};
/// `doubts` as of DoubtsOfFrames, of this map.
MapParts FindParts(const Map& map, const std::vector<FrameTrack>& tracks,
                   const std::vector<double>& doubts);

/// Part of the frames that are in doubt, or outside the largest part of their map.
double PartInDoubt(const Submaps& maps, const std::vector<double>& doubts);

/// Where the maps leave too many frames in doubt or cut off, maps the sequence again, from the
/// longest stretches of frames without doubt, or without any such from any, but those that a map
/// was begun in: a bad start, a turn on the spot or a large object passing by bend a map for good,
/// but not every one that was begun elsewhere. Those that leave clearly less in doubt stay. Loops
/// may put right what two views refute: where there is too much of it they are closed, if
/// `close_loops` is given, before a map is given up.
RemappingReport MapAgainWhereRefuted(const RemappingOptions& options,
                                     const Undistorter& undistorter, int num_threads,
                                     size_t num_frames, const MapFrom& map_from,
                                     MappedSequence& mapped, const CloseLoopsIn& close_loops = {});

}  // namespace s3lam
