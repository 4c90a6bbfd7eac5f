#pragma once

#include <optional>
#include <string>
#include <vector>

#include "s3lam/report/run_folder.h"

namespace s3lam::report {

/// The better comes first.
enum class FrameState { kGood, kWeak, kLost };

/// Consecutive frames in one state. Frames are counted from 0 in the order of the sequence.
struct FrameStretch {
  int first = 0;
  int last = 0;
  int map = 0;  // 0 is the one shown; without meaning where lost.
  FrameState state = FrameState::kGood;
  std::optional<double> mean_trust;

  [[nodiscard]] int Length() const { return last - first + 1; }
};

/// What s3-slam told of one frame.
struct TrustedFrame {
  int map = -1;  // -1: lost.
  bool is_keyframe = false;
  double trust = 0.0;  // 0 to 1.
};

/// How far the frames of a sequence are to be trusted.
struct FrameTrust {
  std::vector<FrameStretch> stretches;  // In order, without gaps; empty if unknown.
  std::vector<TrustedFrame> frames;     // Empty if unknown.

  [[nodiscard]] int NumFrames() const { return stretches.empty() ? 0 : stretches.back().last + 1; }
};

/// As 1_slam/report.json tells it: nothing where there is none, or it is of a version that told
/// nothing of the kind.
FrameTrust ReadFrameTrust(const RunFolder& run);

/// The state of every pose of an arm's trajectory; empty if the poses cannot be told to be those of
/// the frames, or of the keyframes, of the map shown.
std::vector<FrameState> StatesOfTrajectory(const FrameTrust& trust, const Arm& arm);

/// What the stages found doubtful in the run, one sentence each, the gravest first.
std::vector<std::string> DescribeDoubts(const RunFolder& run, const FrameTrust& trust);

}  // namespace s3lam::report
