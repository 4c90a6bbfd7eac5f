#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/base/id.h"
#include "s3lam/geometry/plane.h"
#include "s3lam/scene/reconstruction.h"

namespace s3lam {

/// How surfaces of a class lie in the world by nature.
enum class SurfaceOrientation { kAny, kHorizontal, kVertical };

/// One row of a class table (configs/classes/*.json).
struct SemanticClass {
  int id = 0;  // As in the masks: COCO category id, Cityscapes trainId, ...
  std::string name;
  bool is_thing = false;       // Countable (instances) or stuff.
  bool is_planar = false;      // Planar a priori (paper, section on planes).
  bool is_dynamic = false;     // May move while the sequence is taken.
  int min_plane_inliers = 50;  // A plane of this class needs so many points.
  SurfaceOrientation orientation = SurfaceOrientation::kAny;
  Rgb color{};
};

/// The classes, in ascending id; a class's index is its place here and its column in distributions.
struct ClassTable {
  std::string name;
  std::vector<SemanticClass> classes;

  [[nodiscard]] int size() const { return static_cast<int>(classes.size()); }
  /// Index of the class with this id; empty if there is none.
  [[nodiscard]] std::optional<int> IndexOfId(int class_id) const;
};

/// A segment of one image's mask: its id is local to that image.
struct SegmentRef {
  ImageId image_id;
  uint32_t segment_id = 0;
  auto operator<=>(const SegmentRef&) const = default;
};

/// Points of one object or stretch of stuff: O_k = ({X}, c_k) of the paper.
struct Cluster {
  ClusterId id;
  int class_index = 0;
  std::vector<PointId> points;  // Ascending.
  Eigen::Vector3d centroid_in_world = Eigen::Vector3d::Zero();
  std::vector<SegmentRef> segments;  // Ascending.
};

/// A plane fitted to (part of) a cluster.
struct PlanarSurface {
  PlaneId id;
  ClusterId cluster_id;
  int class_index = 0;
  Plane plane_in_world;  // Normal towards the cameras that see it.
  Eigen::Vector3d centroid_in_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis_u_in_world = Eigen::Vector3d::UnitX();  // In-plane axes, unit, orthogonal.
  Eigen::Vector3d axis_v_in_world = Eigen::Vector3d::UnitY();
  std::vector<Eigen::Vector2d> extent;  // Convex outline in (u, v) about the centroid [map units].
  std::vector<PointId> inliers;         // Ascending.
  double rms = 0.0;                     // Of the inliers' distances [map units].
  double rms_sigma = 0.0;               // The same in units of each point's predicted sigma.
  /// Covariance of (rotation about u [rad], rotation about v [rad], shift along the normal at the
  /// centroid [map units]).
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

/// What stage 2 knows of a reconstruction.
struct SemanticMap {
  ClassTable class_table;
  /// Row order of `distributions`: all points of the model with at least one mask observation.
  std::vector<PointId> points;
  /// points x classes, each row a distribution.
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> distributions;
  std::vector<int> num_mask_observations;   // Per row.
  std::vector<ClusterId> cluster_of_point;  // Per row; invalid for points in no cluster.
  std::map<ClusterId, Cluster> clusters;
  std::map<PlaneId, PlanarSurface> planes;
  /// Identifies the model the ids belong to (FingerprintOfModel).
  std::string model_fingerprint;
};

/// Throws InputError naming `source` unless all references within the map, and to points of the
/// reconstruction, hold, and planes have finite unit normals.
void CheckSemanticMap(const SemanticMap& map, const Reconstruction& reconstruction,
                      const std::string& source);

/// A short text that changes when the ids of a model's images and points, the translations of its
/// poses or the places of its points change.
std::string FingerprintOfModel(const Reconstruction& reconstruction);

/// Throws InputError naming `source` unless the map was made from the model of this fingerprint:
/// the same ids would mean other points.
void CheckMadeFromModel(const SemanticMap& map, const std::string& fingerprint,
                        const std::string& source);

}  // namespace s3lam
