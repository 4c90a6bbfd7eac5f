#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "s3lam/base/timer.h"
#include "s3lam/refine/frame_refinement.h"
#include "s3lam/refine/gravity.h"
#include "s3lam/refine/outer_loop.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// One state of the map: as read, after plain bundle adjustment, after planes.
struct ArmReport {
  std::string name;  // "input", "plain", "planar"
  /// Over the observations that are in use at the end, the same for every arm [px].
  double reprojection_rms_px = 0.0;
  /// Over the members of planes at the end, each plane fitted to its members in this arm.
  double plane_rms = 0.0;          // [map units]
  double plane_rms_sigma = 0.0;    // [sigma]
  double pose_moved_median = 0.0;  // Camera centres, from the input [map units]
  double pose_moved_max = 0.0;
  double rotation_moved_max_deg = 0.0;
  double point_moved_median = 0.0;  // [map units]
};

struct PlaneReport {
  PlaneId id;
  std::string class_name;
  size_t points = 0;
  double kappa = 0.0;
  std::vector<double> rms;        // Per arm [map units].
  std::vector<double> rms_sigma;  // Per arm [sigma].
  double turned_deg = 0.0;        // Normal fitted in the first arm to the last one's plane.
};

/// Two planes that are nearly parallel or at nearly right angles in the input.
struct PlanePairReport {
  PlaneId a, b;
  PlaneRelation relation = PlaneRelation::kParallel;
  bool enforced = false;
  std::vector<double> deviation_deg;  // Per arm, of the planes fitted to the members.
};

/// Two parallel planes whose distance is known.
struct PlaneDistanceReport {
  PlaneId a, b;
  double known = 0.0;            // [map units]
  std::vector<double> measured;  // Per arm, between the planes fitted to the members [map units].
};

struct RefineReport {
  size_t num_images = 0, num_images_in_use = 0;
  size_t num_points = 0, num_points_in_use = 0;
  ObservationCounts observations;
  MembershipCounts membership;
  std::string plane_mode;
  std::string note;  // Why it is plain bundle adjustment, if it is one although planes were wanted.
  size_t num_retriangulated = 0, num_merged = 0;      // Points, over all iterations.
  size_t num_exact_planes = 0, num_exact_points = 0;  // Mode hard.
  double keypoint_sigma_px = 0.0;                     // Of the median keypoint, given or measured.
  bool keypoints_differ = false;                      // Each has a sigma of its own.
  double median_depth = 0.0;                          // [map units]
  double metres_per_unit = 0.0;  // If the camera's height is known: the output is in metres.
  /// Of the distance held at the end since the input, relative: zero if the gauge held, and was the
  /// same all along.
  double gauge_scale_change = 0.0;
  GroundReport ground;
  FrameRefinementReport frames;
  GravityReport gravity;
  /// All, if any were to be refined; else those whose calibration was checked (CheckKeptCameras).
  std::vector<IntrinsicsReport> cameras;
  std::vector<ArmReport> arms;
  std::vector<PlaneReport> planes;
  std::vector<PlanePairReport> pairs;
  std::vector<PlaneDistanceReport> distances;
  std::vector<OuterIteration> iterations;
  StepTimes seconds;
  double peak_memory_mib = 0.0;
};

/// Cameras, poses and points of one arm.
struct ArmState {
  std::string name;
  std::vector<Camera> cameras;
  std::vector<PoseBlock> poses;
  std::vector<Eigen::Vector3d> points;
};

/// Fills arms, planes, pairs and distances from the states (the first is the input, the last the
/// result).
void CompareArms(const std::vector<ArmState>& states, const BundleMap& map, const PlaneModel& model,
                 const PlaneSigmaOptions& sigma, double sigma_px, const ClassTable& classes,
                 RefineReport& report);

nlohmann::json ToJson(const RefineReport& report);
/// A table for people.
std::string ToTable(const RefineReport& report);

}  // namespace s3lam
