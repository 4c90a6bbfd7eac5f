#pragma once

#include "s3lam/slam/pipeline.h"
#include "s3lam/slam/run_state.h"

namespace s3lam::slam {

/// Says whether the lines of the images were exposed one after another, and, if asked for, corrects
/// for it: keypoints are moved to where a global shutter would have put them, the maps adjusted and
/// all frames' poses refined with that: twice with a readout time that is given, since the first
/// changes the motion, else until the one that is estimated settles, six times at the most.
/// `localized` is as of LocalizeInMaps.
void HandleRollingShutter(const Options& options, const Input& input,
                          const Undistorter& undistorter, const Submaps& maps,
                          std::vector<std::vector<FrameTrack>>& localized, Report& report);

}  // namespace s3lam::slam
