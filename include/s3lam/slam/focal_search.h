#pragma once

#include <functional>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/optim/self_calibration.h"
#include "s3lam/slam/initializer.h"
#include "s3lam/slam/mapper.h"
#include "s3lam/slam/place_recognition.h"
#include "s3lam/slam/tracker.h"

namespace s3lam {

struct FocalSearchOptions {
  int first_frames = 120;
  double enough_relative_sigma = 0.01;
  double settled_change = 0.01;
  int max_rounds = 4;

  void Visit(OptionVisitor& v);
};

/// What trial maps are made with.
struct TrialMapOptions {
  FocalSearchOptions search;
  SelfCalibrationOptions self_calibration;
  FeatureOptions features;
  InitializerOptions initializer;
  TrackerOptions tracker;
  MapperOptions mapper;
  int num_threads = 1;
};

/// Looks for the focal length of a camera of which there is only a guess, so that the whole
/// sequence can be mapped with it: trial maps of a stretch of frames are made with focal lengths as
/// far apart as the prior is wide, and each is adjusted with focal length and distortion free. The
/// camera that explains its observations best, not counting those that track few frames, is tried
/// again until its focal length stays. Where that comes to nothing that can be believed, the same
/// is done with focal lengths twice as far off. The stretch is doubled until it determines the
/// focal length, or is the whole sequence. Empty if no trial gives a map with a camera to believe.
std::optional<CameraRefinement> SearchFocal(const TrialMapOptions& options,
                                            const std::vector<FrameFeatures>& frames,
                                            const Vocabulary& vocabulary, const Camera& guess,
                                            const FocalPrior& prior);

/// False if a focal length is far from what was known of it beforehand, and not even sure: a map
/// that went wrong gives such ones, while one that does not determine it leaves it where it was.
bool IsBelievable(const CameraRefinement& refinement, const FocalPrior& prior);

/// CalibrationProblem::Observation::per_readout of what a keyframe sees of a point.
using PerReadout = std::function<Eigen::Vector2d(const MapObservation&, const MapPoint&)>;

/// What the keyframes saw of the points, in original pixels.
CalibrationProblem MakeCalibrationProblem(const Map& map, const PerReadout& per_readout = {});
/// Moves the keyframes and points of that map to where the refinement found them.
void ApplyRefinement(const CameraRefinement& refinement, Map& map);

}  // namespace s3lam
