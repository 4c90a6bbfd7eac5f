#pragma once

#include <cstdint>
#include <vector>

#include "s3lam/slam/pipeline.h"
#include "s3lam/slam/run_state.h"

// The last steps of a run: what it has come to, and how far that is to be trusted.

namespace s3lam::slam {

/// What pairs of keyframes say of the frames of a map. Few matches refute the exactness of a map
/// only, see DoubtsOfFrames: they make a contradiction, but nothing refuted or cut off.
struct TwoViewVerdict {
  std::vector<double> contradictions;
  std::vector<uint8_t> is_refuted;
  std::vector<uint8_t> is_cut_off;  // By refuted frames from the largest part of the map.
};

/// Per map.
std::vector<TwoViewVerdict> JudgeMaps(const Options& options, const Undistorter& undistorter,
                                      const Submaps& maps,
                                      const std::vector<std::vector<FrameTrack>>& localized);

/// The models of all maps, and the report; warns of what is in doubt.
Result MakeResult(const Options& options, const Input& input,
                  const std::vector<std::vector<FrameTrack>>& localized,
                  const std::vector<TwoViewVerdict>& verdicts, RunState& state);

}  // namespace s3lam::slam
