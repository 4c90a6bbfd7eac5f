#pragma once

#include "s3lam/slam/pipeline.h"

namespace s3lam::slam {

/// Removes keyframes that see too little of their finished map to count as localised.
void EraseWeakKeyframes(const Options& options, const Submaps& maps);

/// Localises every frame in its map, one that was lost in the first that knows it: keyframes are
/// where they are, others are refined against the final map, by patches too where keyframes are.
/// By map, then by frame; not tracked where a frame belongs to another map, or sees too little.
std::vector<std::vector<FrameTrack>> LocalizeInMaps(const Options& options, const Input& input,
                                                    const Undistorter& undistorter,
                                                    const Submaps& maps, size_t num_frames);

/// Refines the poses of all frames of LocalizeInMaps in the maps as they are now, with the points
/// that are left of what they saw: keyframes are where they are.
void RefineInMaps(const Options& options, const Submaps& maps,
                  std::vector<std::vector<FrameTrack>>& localized);

}  // namespace s3lam::slam
