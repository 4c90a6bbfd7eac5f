#pragma once

#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/refine/covariance.h"
#include "s3lam/refine/frame_refinement.h"
#include "s3lam/refine/gravity.h"
#include "s3lam/refine/outer_loop.h"
#include "s3lam/refine/report.h"
#include "s3lam/scene/constraints.h"
#include "s3lam/scene/keypoint_sigmas.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"
#include "s3lam/scene/trajectory.h"

namespace s3lam::refine {

struct Options : OuterLoopSettings {
  FrameRefinementOptions frames;
  GravityOptions gravity;
  CovarianceOptions covariance;
  int num_threads = 0;  // Not a configuration value: results do not depend on it.

  void Visit(OptionVisitor& v);
};

struct Input {
  Reconstruction model;
  SemanticMap semantics;  // Without planes: plain bundle adjustment.
  /// Times of the model's images in ascending image id; empty if unknown.
  std::vector<double> image_times_s;
  Trajectory frames;  // Poses of all frames in the model's world; may be empty.
  /// What frames that are no images of the model see of its points; may be empty.
  FrameObservations observations;
  Constraints constraints;
  KeypointSigmas keypoint_sigmas;  // Empty: alike in each camera.
  PointDescriptors descriptors;    // What the points look like; may be empty.
  StepStore* steps = nullptr;      // Where solves are kept, for a run that can be gone on with.
};

struct Output {
  Reconstruction model;
  SemanticMap semantics;
  Trajectory keyframes;  // The model's images, if their times are known.
  Trajectory frames;
  FrameObservations observations;  // Those of points that are left.
  OutputCovariance covariance;     // If asked for.
};

using Report = RefineReport;

/// The planar bundle adjustment: minimises
///   sum_ij rho(|| x_ij - proj(T_i, X_j) ||) + sum_k sum_{j in O_k} rho(|| pi_k^T X_j || / sigma_j)
/// over poses and points (and planes, if joint), in rounds between which outliers and the points of
/// planes are chosen anew. The frame of the first image and the distance to the farthest one are
/// held, unless constant parts or pose priors hold the world; the map is brought into the priors'
/// world first, if it is in another. Throws InputError if the model cannot
/// be adjusted (fewer than two images that see common points), std::runtime_error if the adjustment
/// fails.
Report Run(const Options& options, const Input& input, Output& output);

}  // namespace s3lam::refine
