#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/refine/bundle_solver.h"
#include "s3lam/refine/problem_builder.h"
#include "s3lam/robust/flat_cells.h"
#include "s3lam/robust/plane_fit.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// What the sigma of a point-plane residual is made of.
enum class PlaneSigmaKind {
  kPixel,  // kappa of the class x keypoint sigma x depth / f: has no unit, follows the scene.
  kRelativeDepth,  // alpha x the map's median depth: alpha = 0.01 is the paper's weight.
  kMetric,         // metres / metres_per_unit.
};

struct PlaneSigmaOptions {
  PlaneSigmaKind kind = PlaneSigmaKind::kPixel;
  /// Keypoints of a track err in common: maps of rendered scenes are off by 1.5 to 4 times what
  /// independent errors of theirs come to, which kappa does not see where planes follow.
  double min_kappa = 3.0;
  double max_roughness_px = 1.0;
  double alpha = 0.01;
  double metres = 0.01;
  double metres_per_unit = 1.0;

  void Visit(OptionVisitor& v);
};

struct MembershipOptions {
  double max_sigma = 1.96;
  double leave_sigma = 6.0;
  double extent_margin = 0.2;
  int min_points = 10;
  FlatCellOptions cells;

  void Visit(OptionVisitor& v);
};

enum class PlaneMode {
  kOff,    // Global bundle adjustment only.
  kFixed,  // The paper: planes held fixed in a solve, fitted anew between solves.
  kJoint,  // Planes are optimised together with poses and points.
  kHard,   // Joint, and the points of planes with overwhelming evidence are exactly on them.
};

/// "off", "fixed", ...
std::string PlaneModeName(PlaneMode mode);

struct PlaneOptions {
  PlaneMode mode = PlaneMode::kJoint;
  PlaneSigmaOptions sigma;
  MembershipOptions membership;

  void Visit(OptionVisitor& v);
};

/// One plane and the points that may lie on it. Indices are into BundleProblem's tables.
struct PlaneState {
  PlaneId id;
  ClusterId cluster_id;
  int class_index = 0;
  std::vector<int> candidates;  // Ascending: inliers handed over, and its cluster's points nearby.
  std::vector<int> members;     // Ascending: points with a term at present.
  double kappa = 0.0;
  /// Points less certain than this [map units] cannot be told from the plane's wrong candidates.
  double max_uncertainty = std::numeric_limits<double>::infinity();
  bool is_ground = false;  // A stretch of the ground under the cameras' path.
  bool is_piece = false;   // One of several of a surface that bends.
  bool in_use = true;      // False once it has too few members.
};

/// Planes with the uncertainty of their points.
struct PlaneModel {
  std::vector<PlaneState> planes;            // As BundleProblem::planes.
  std::vector<double> keypoint_size;         // See KeypointSizes.
  std::vector<Eigen::Matrix3d> covariances;  // See TriangulationCovariances.
  std::vector<double> kappa_of_class;        // Zero for classes without a plane.
  double median_depth = 0.0;                 // [map units]
  double ground_strength = 1.0;              // Of the terms that tie cameras to the ground.
  uint32_t next_id = 0;                      // Above those of all planes of the semantic map.
};

/// The planes of the semantic map, anchored at the centroid of their inliers, whose points the
/// problem has; adds them to the problem. Candidates are the inliers and the points of the same
/// cluster within the inliers' extent (grown by extent_margin) that are nearest to this plane.
PlaneModel BuildPlaneModel(const MembershipOptions& options, const SemanticMap& semantics,
                           BundleMap& map);

/// Recomputes what an outer iteration keeps frozen: pixel sizes and covariances.
void FreezeUncertainty(const BundleProblem& problem, double sigma_px, PlaneModel& model);

/// Finds the planes among their candidates as the points are now, together with kappa per class, in
/// rounds: kappa by the MAD of the points near their plane (the value for which |distance| /
/// sqrt(triangulation^2 + (kappa sigma_px z / f)^2) has the median of a unit normal's; at least
/// min_kappa), planes fitted anew to their inliers. Planes start where they were handed over; once
/// they have settled, kappa is held to max_roughness_px and parts of a surface that do not lie on
/// the plane (FlatCells) leave it with all their points. The ground keeps its: drift of scale bends
/// it.
void InitialisePlanes(const PlaneOptions& options, double sigma_px, PlaneModel& model,
                      BundleProblem& problem);

/// How far points scatter about their plane, one standard deviation [map units], which a
/// point-plane term is weighed with. Kappa above 1 is roughness, and errors that the keypoints of a
/// track share.
double PlaneSigma(const PlaneSigmaOptions& options, const PlaneModel& model, double sigma_px,
                  const PlaneState& plane, int point);

/// The chosen points with the uncertainty of their distance to the plane: of their triangulation
/// and of the surface.
std::vector<UncertainPoint> UncertainPoints(const PlaneSigmaOptions& options, double sigma_px,
                                            const PlaneState& state,
                                            const std::vector<int>& indices,
                                            const PlaneModel& model, const BundleProblem& problem);

/// A plane fitted to its members as they are; empty if they do not span one.
std::optional<PlaneFit> FitMembers(const PlaneSigmaOptions& options, double sigma_px,
                                   const PlaneState& state, const PlaneModel& model,
                                   const BundleProblem& problem);

/// Fits every plane in use (or only those that solves hold constant) to its members anew.
void RefitPlanes(const PlaneSigmaOptions& options, double sigma_px, bool constant_only,
                 PlaneModel& model, BundleProblem& problem);

struct MembershipCounts {
  size_t members = 0;
  size_t outliers = 0;  // Candidates above max_sigma.
  size_t expelled = 0;  // Above leave_sigma: candidates no more.
  size_t changed = 0;
};

/// Decides for every candidate whether it lies on its plane, by the distance it would have without
/// the plane's pull in a solve by `solver` (chi-squared, 95 %, 1 dof), and writes the terms into
/// the problem. Points of the ground are chosen once, before the cameras' heights pull at it.
MembershipCounts AssignPoints(const MembershipOptions& options, const PlaneSigmaOptions& sigma,
                              const BundleSolverOptions& solver, PlaneModel& model,
                              BundleProblem& problem);

/// Takes relations and camera heights off planes that have too few points: nothing else holds
/// those.
void DropUnusedStructure(const PlaneModel& model, BundleProblem& problem);

}  // namespace s3lam
