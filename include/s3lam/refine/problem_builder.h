#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/refine/bundle_problem.h"
#include "s3lam/scene/descriptor.h"
#include "s3lam/scene/keypoint_sigmas.h"
#include "s3lam/scene/reconstruction.h"

namespace s3lam {

struct OutlierOptions {
  double max_reprojection_sigma = 4.0;
  double min_depth_ratio = 1e-3;
  int min_image_observations = 6;

  void Visit(OptionVisitor& v);
};

/// What tells whether two points may be the same.
struct PointLook {
  bool is_known = false;
  int group = -1;  // Points of different groups are not the same.
  BinaryDescriptor descriptor{};
};

/// A reconstruction as a bundle problem, with the way back. Every observation of the model is kept
/// in `observations`; the problem holds those that are in use at the moment.
struct BundleMap {
  BundleProblem problem;
  std::vector<ImageId> image_ids;  // Per pose, ascending.
  /// Per camera of the problem: those of the model that it stands for.
  std::vector<std::vector<CameraId>> camera_ids;
  std::vector<PointId> point_ids;               // Per point, ascending.
  std::vector<TrackElement> elements;           // Per observation.
  std::vector<BundleObservation> observations;  // Grouped by point, points ascending.
  std::vector<uint8_t> is_used;                 // Per observation: is in problem.observations.
  std::vector<PointLook> looks;                 // Per point; empty if nothing is known.
  std::map<PointId, PointId> merged_into;       // What has become of points that are gone.
  bool keypoints_differ = false;                // Each has a sigma of its own.
  /// Where points were when their poses were adjusted; empty: where they are.
  std::vector<Eigen::Vector3d> points_as_adjusted;

  /// Index of a point; -1 if the model does not have it.
  [[nodiscard]] int IndexOfPoint(PointId id) const;
};

/// All images and points, none used yet: call SelectObservations. The sigmas of the keypoints, one
/// for every keypoint or none at all, become parts of their median over the observations; without
/// them, of the size of images.
BundleMap BuildBundleMap(const Reconstruction& reconstruction, const KeypointSigmas& sigmas = {});

/// How many observations are in use and what was left out, and why.
struct ObservationCounts {
  size_t total = 0;
  size_t used = 0;
  size_t behind = 0;    // At less than min_depth_ratio of the median depth.
  size_t outliers = 0;  // Above max_reprojection_sigma.
  size_t too_few = 0;   // Of a point seen by one image, or an image that sees too little.
  size_t changed = 0;   // Use differs from before the call.
};

/// Decides anew for every observation whether it is used, at the present poses and points: in front
/// of its camera, error at most max_reprojection_sigma of its keypoint (no limit if
/// `keep_large_errors`), of a point that two or more images see, in an image that sees enough.
ObservationCounts SelectObservations(const OutlierOptions& options, double sigma_px,
                                     bool keep_large_errors, BundleMap& map);

/// The pose that is given, else the first one in use, as the fixed one, and the one in use that is
/// farthest from it to hold the scale.
Gauge ChooseGauge(const BundleProblem& problem, int fixed_pose = -1);

/// Unless each keypoint has a sigma of its own, lets those of a camera count by its median
/// reprojection error at the present poses and points, or by the size of its images if it saw too
/// little: cameras may differ in resolution. Returns the largest part that a sigma changed by.
double MeasureCameraSigmas(BundleMap& map);

/// Standard deviation of a keypoint of relative sigma one [px], from the median reprojection error
/// of all observations, those not in use among them, since a choice by their error would make it
/// too small; at least 0.05, so that exact data does not make it zero.
double MeasureKeypointSigma(const BundleMap& map);

/// Inverse of the Hessian of each point's reprojection errors with the poses held: the covariance
/// of its triangulation [map units^2]; zero for a point that is not in use.
std::vector<Eigen::Matrix3d> TriangulationCovariances(const BundleProblem& problem,
                                                      double sigma_px);

/// Per point: median depth over the cameras that see it [map units]; zero for a point that is not
/// in use.
std::vector<double> DepthsOfPoints(const BundleProblem& problem);

/// Per point: median depth over the cameras that see it divided by their focal length, i.e. the
/// size of a pixel at the point [map units / px]; zero for a point that is not in use.
std::vector<double> PixelSizes(const BundleProblem& problem);

/// The same with each camera's pixel times the relative sigma of the keypoint there: what a point's
/// keypoints are uncertain by at the point, in units of sigma_px.
std::vector<double> KeypointSizes(const BundleProblem& problem);

/// The reconstruction with refined cameras, poses and points, without the observations that are not
/// in use and the points that have fewer than two left, but for constant ones. Images that were not
/// in the problem keep their pose.
Reconstruction ToReconstruction(const BundleMap& map, const Reconstruction& original);

}  // namespace s3lam
