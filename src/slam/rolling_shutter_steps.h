#pragma once

#include "s3lam/slam/pipeline.h"
#include "s3lam/slam/run_state.h"

namespace s3lam::slam {

/// Says whether the lines of the images were exposed one after another, and, if asked for, corrects
/// for it: keypoints are moved to where a global shutter would have put them, the maps adjusted and
/// all frames' poses refined with that, six times, since each changes the motion that the next one
/// is made by, or until a readout time that is estimated settles. `localized` is as of
/// LocalizeInMaps.
void HandleRollingShutter(const Options& options, const Input& input,
                          const Undistorter& undistorter, const Submaps& maps,
                          std::vector<std::vector<FrameTrack>>& localized, Report& report);

}  // namespace s3lam::slam
