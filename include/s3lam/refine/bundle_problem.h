#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "s3lam/geometry/camera.h"
#include "s3lam/geometry/plane.h"
#include "s3lam/refine/manifolds.h"

namespace s3lam {

/// One keypoint that sees one point. Indices are into BundleProblem's tables.
struct BundleObservation {
  int pose = 0;
  int point = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // px
  double sigma = 1.0;  // Of the pixel, in units of BundleSolverOptions::sigma_px.
};

/// A plane (n, h) with n . (x - anchor) + h = 0, |n| = 1.
struct AnchoredPlane {
  Eigen::Vector4d parameters = Eigen::Vector4d::UnitZ();
  Eigen::Vector3d anchor_in_world = Eigen::Vector3d::Zero();
  bool is_constant = false;

  [[nodiscard]] Plane PlaneInWorld() const;
  static AnchoredPlane FromPlane(const Plane& plane_in_world, const Eigen::Vector3d& anchor);
};

/// A point lies on a plane, up to sigma [map units], or exactly: then it has two coordinates in the
/// plane, moves with it, and has this term only.
struct PointOnPlane {
  int point = 0;
  int plane = 0;
  double sigma = 1.0;
  bool is_exact = false;
};

/// A camera is at the common height above a ground plane, up to sigma [part of the height].
struct HeightTerm {
  int pose = 0;
  int plane = 0;
  double sigma_relative = 0.01;
};

/// A pose is known beforehand; a sigma of zero: not known.
struct PosePriorTerm {
  int pose = 0;
  Rigid3 cam_from_world;
  double sigma_position = 0.0;  // [map units]
  double sigma_rotation = 0.0;  // [rad]
};

enum class PlaneRelation {
  kParallel,
  kOrthogonal,
  kCoplanar,
  kAtDistance,  // Parallel, and known to be so far apart.
  kMeeting,     // Nearly parallel and without a step between them: pieces of a bending ground.
};

/// Two planes stand in a relation, up to sigma_rad and, for all but parallel and orthogonal ones,
/// up to sigma_offset [map units] at a place.
struct RelationTerm {
  PlaneRelation relation = PlaneRelation::kParallel;
  int plane_a = 0;
  int plane_b = 0;
  double sigma_rad = 0.01;
  double sigma_offset = 1.0;
  Eigen::Vector3d place_in_world = Eigen::Vector3d::Zero();
  double distance = 0.0;  // Of plane a behind plane b, seen along a's normal [map units].
};

/// What holds the seven freedoms of the world frame: a constant pose (six) and a second camera
/// whose centre keeps its distance to the first one's (the scale). Indices into poses; -1 where
/// something else holds them.
struct Gauge {
  int fixed_pose = -1;
  int scale_pose = -1;
};

/// A bundle adjustment as plain tables: what is variable, what it is tied to. Knows nothing of how
/// it is solved.
struct BundleProblem {
  std::vector<Camera> cameras;
  std::vector<PoseBlock> poses;
  std::vector<int> camera_of_pose;
  std::vector<uint8_t> pose_is_constant;
  std::vector<Eigen::Vector3d> points;
  std::vector<uint8_t> point_is_constant;  // Empty: none.
  /// Per camera: indices of the parameters that are optimised; empty: of no camera.
  std::vector<std::vector<int>> free_camera_params;
  std::vector<PosePriorTerm> pose_priors;
  /// Grouped by point, points ascending.
  std::vector<BundleObservation> observations;
  std::vector<AnchoredPlane> planes;
  std::vector<PointOnPlane> points_on_planes;  // Ascending by point.
  std::vector<RelationTerm> relations;
  std::vector<HeightTerm> heights;
  double height = 1.0;  // The common height [map units]; a variable if there are height terms.
  Gauge gauge;

  /// For every pose: has it observations?
  [[nodiscard]] std::vector<uint8_t> UsedPoses() const;
  [[nodiscard]] bool IsConstantPoint(int point) const {
    return !point_is_constant.empty() && point_is_constant[point] != 0;
  }
  /// Of a camera: how many of its parameters are optimised.
  [[nodiscard]] int NumFreeParams(int camera) const {
    return free_camera_params.empty() ? 0 : static_cast<int>(free_camera_params[camera].size());
  }
  /// The centre of a pose's camera, in the world.
  [[nodiscard]] Eigen::Vector3d CenterOf(int pose) const;
};

}  // namespace s3lam
