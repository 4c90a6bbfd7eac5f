#pragma once

#include <cstddef>
#include <map>

#include "s3lam/base/options.h"
#include "s3lam/scene/frame_observations.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/trajectory.h"

namespace s3lam {

/// Poses of frames that are no keyframes, against the refined map.
struct FrameRefinementOptions {
  bool enabled = true;
  int min_inliers = 15;
  double min_inlier_share = 0.5;

  void Visit(OptionVisitor& v);
};

struct FrameRefinementReport {
  size_t num_frames = 0;   // In the trajectory.
  size_t num_refined = 0;  // The others go along with the keyframes.
};

/// Throws InputError naming `source` unless every camera is one of the model's and every point
/// observed is one of the model's, and every frame is in the trajectory (by its time).
void CheckFrameObservations(const FrameObservations& observed, const Reconstruction& model,
                            const Trajectory& frames, const std::string& source);

/// Refines the pose of every frame that has observations against the map's points, held fixed, from
/// where `frames` has it. Frames with fewer than min_inliers inliers, or whose inliers are a
/// smaller share than min_inlier_share of what they see of the map, stay where they are. The result
/// does not depend on the number of threads.
FrameRefinementReport RefineFrames(const FrameRefinementOptions& options,
                                   const Reconstruction& refined, const FrameObservations& observed,
                                   int num_threads, Trajectory& frames);

/// The observations of points that have become another are of that one; a frame that would see it
/// twice keeps the first.
FrameObservations FollowMergedPoints(const FrameObservations& observed,
                                     const std::map<PointId, PointId>& merged_into);

/// Without the observations of points that the model does not have.
FrameObservations KeepKnownPoints(const FrameObservations& observed, const Reconstruction& model);

}  // namespace s3lam
