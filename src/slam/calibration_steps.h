#pragma once

#include "s3lam/slam/pipeline.h"
#include "s3lam/slam/run_state.h"

// The steps of a run that change its camera, and adjust what depends on it.

namespace s3lam::slam {

/// Bundle adjustment of every map as a whole.
void AdjustMaps(const Options& options, const Submaps& maps);

/// A focal length to begin with, where there is only a guess.
FocalReport SearchCamera(const Options& options, const Input& input, const Vocabulary& vocabulary,
                         std::vector<FrameFeatures>& frames, Undistorter& undistorter);

/// Refines a camera that is not known with the largest map, and adjusts all maps to it.
void RefineCamera(const Options& options, const FocalPrior& prior,
                  std::vector<FrameFeatures>& frames, Undistorter& undistorter, const Submaps& maps,
                  FocalReport& report);

/// Checks the calibration against the largest map; where the distortion is refined, everything is
/// undistorted and adjusted again; the report says where the rest is in doubt.
void Recalibrate(const Options& options, std::vector<FrameFeatures>& frames,
                 Undistorter& undistorter, const Submaps& maps, Report& report);

/// What is left to be found of the camera, when the maps are done: all of one that is not known,
/// else the lens distortion, see Recalibrate.
void Calibrate(const Options& options, const Input& input, RunState& state);

/// As AdjustAligned, or as AdjustMaps where observations are not aligned.
void AdjustFinally(const Options& options, const Undistorter& undistorter, const Submaps& maps);

/// Adjusts maps whose observations are aligned, with the noise that these turn out to have, until
/// no outlier is left. Not before the camera is refined: what is wrong with it must not count as
/// one.
void AdjustAligned(const Options& options, const Undistorter& undistorter, const Submaps& maps);

}  // namespace s3lam::slam
