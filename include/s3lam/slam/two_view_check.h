#pragma once

#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/slam/map.h"

namespace s3lam {

struct TwoViewCheckOptions {
  bool enabled = true;
  int min_matches = 30;
  uint64_t seed = 0;  // Of the samples drawn; from the command line.

  void Visit(OptionVisitor& v);
};

/// Two keyframes of a map, matched without its help.
struct TwoViewCheck {
  int frame_a = kNoIndex;  // The earlier one, by its frame in the sequence.
  int frame_b = kNoIndex;
  int num_matches = 0;
  int num_of_map = 0;   // Matches on the epipolar lines that the poses in the map give.
  int num_of_best = 0;  // And that the best motion of these two views alone gives; never less.

  /// Share of what two views can explain that the map does not, beyond what a fitted motion
  /// explains by chance; in [0, 1].
  [[nodiscard]] double Contradiction() const;
};

/// Whether the map agrees with pairs of its keyframes that are matched by looks alone. A map that
/// bent still fits what it kept, having dropped what did not fit; seen without it, the two views
/// tell. Pairs are a few keyframes apart in time; left out are those with fewer than `min_matches`
/// matches, and those with many between points that some keyframe sees at two places: where things
/// repeat, looks tell of another motion than there was. In ascending order of frames, the same on
/// any number of threads.
std::vector<TwoViewCheck> CheckTwoViews(const TwoViewCheckOptions& options, const Map& map,
                                        const Undistorter& undistorter, int num_threads);

/// In [0, 1]: how surely a contradiction tells that a map is wrong. Those of right maps stay below
/// a quarter of what refutes for sure.
double Refutation(double contradiction);
/// From here on it is taken for wrong.
inline constexpr double kRefuted = 0.5;

/// Per frame of the sequence, the largest contradiction of the pairs that lie around it, or 0.
std::vector<double> ContradictionOfFrames(const std::vector<TwoViewCheck>& checks,
                                          size_t num_frames);

}  // namespace s3lam
