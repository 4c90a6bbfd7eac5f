#pragma once

#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/refine/bending_planes.h"
#include "s3lam/refine/bundle_solver.h"
#include "s3lam/refine/exact_planes.h"
#include "s3lam/refine/ground.h"
#include "s3lam/refine/intrinsics.h"
#include "s3lam/refine/plane_model.h"
#include "s3lam/refine/problem_builder.h"
#include "s3lam/refine/relations.h"
#include "s3lam/refine/retriangulation.h"
#include "s3lam/refine/solve_journal.h"

namespace s3lam {

struct OuterLoopOptions {
  int max_iterations = 6;
  double max_changed = 1e-3;

  void Visit(OptionVisitor& v);
};

/// One round of: choose observations and points of planes, solve.
struct OuterIteration {
  bool with_planes = false;
  BundleSolverReport solve;
  ObservationCounts observations;
  MembershipCounts membership;
  size_t exact_points = 0;  // On planes, exactly (mode hard).
  size_t retriangulated = 0;
  size_t merged = 0;
  double seconds = 0.0;
};

struct OuterLoopSettings {
  double keypoint_sigma_px = 0.0;  // 0: measured.
  BundleSolverOptions solver;
  OutlierOptions outliers;
  IntrinsicsOptions intrinsics;
  PlaneOptions planes;
  ExactPlaneOptions exact_planes;
  RetriangulationOptions retriangulation;
  BendingOptions bending;
  RelationOptions relations;
  CameraHeightOptions camera_height;
  OuterLoopOptions outer;
  SolveJournal* journal = nullptr;  // Not a configuration value: what solves lead to is kept in it.
};

/// What bundle adjustment with planes came to.
struct PlanarReport {
  std::vector<OuterIteration> iterations;  // Empty: no plane took part.
  GroundReport ground;
  /// Those that were refined with the camera's height, and which parameters (per camera of the
  /// problem); empty: none.
  std::vector<IntrinsicsReport> cameras;
  std::vector<std::vector<int>> refined_camera_params;
};

/// Bundle adjustment without planes, again until the outliers settle. Sets solver.sigma_px, on
/// which rest the outliers, the uncertainty of points and so what lies on a plane, to the
/// keypoints' sigma as given or as measured. Logs one line per iteration. Throws std::runtime_error
/// if a solve fails or, without having converged, improves nothing.
std::vector<OuterIteration> AdjustPlain(OuterLoopSettings& settings, BundleMap& map);

/// Bundle adjustment with planes, after AdjustPlain: update the planes, assign points to them,
/// solve, drop outliers, again until next to nothing changes. The kappa of each class is taken from
/// the points as they are at the start, without the planes' pull; at the end the points of planes
/// are flattened (FlattenPoints). With the camera's height, if asked for (`ground` says what was
/// found). Where that varies by more than can be explained, radial distortions are refined with it
/// and its weight is raised; if the map contradicts it (CameraHeights), or the cameras cannot be
/// believed then, again from the start with the cameras as they were. If that is contradicted as
/// well, again without heights in mode auto, with weights that are not raised in mode on. Leaves
/// the map as it is and reports no iterations if planes are off or none has enough points near it,
/// be it only after some rounds. Logs and throws as above.
PlanarReport AdjustPlanar(const OuterLoopSettings& settings, const SemanticMap& semantics,
                          PlaneModel& planes, BundleMap& map);

}  // namespace s3lam
