#pragma once

#include <map>
#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/geometry/plane.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"
#include "s3lam/synthetic/scene.h"

namespace s3lam {

/// What a SLAM run and semantic lifting would hand over, made directly: for tests and benchmarks of
/// later stages.
struct SyntheticMapOptions {
  int num_images = 40;            // Spread evenly over the scene's path.
  int num_points = 3000;          // Tried; those seen by fewer than three images are dropped.
  int max_track_window = 0;       // A point is seen within +- so many images of the one that found
                                  // it; 0: by all that can see it.
  double pixel_sigma = 0.5;       // Noise of the keypoints [px].
  double outlier_fraction = 0.0;  // Of the observations: moved by 5..50 px.
  double point_sigma = 0.0;       // Error of points in the estimate, relative to the median depth.
  double center_sigma = 0.0;      // Error of camera centres, relative to the median depth.
  double rotation_sigma_deg = 0.0;  // Error of camera rotations [deg].
  /// Drift: a random walk of similarity transforms along the images, carrying cameras and the
  /// points that each of them found; per image.
  double drift_rotation_deg = 0.0;    // [deg]
  double drift_translation = 0.0;     // Relative to the median depth.
  double drift_scale = 0.0;           // Standard deviation of the log-scale step.
  double drift_scale_trend = 0.0;     // Mean of the log-scale step.
  double wrong_label_fraction = 0.0;  // Of the points of planar clusters: from another object.
  double map_scale = 1.0;             // Map units per metre in the estimate.
  void Visit(OptionVisitor& v) {
    v.Value("num_images", num_images, "images, spread evenly over the path", 2, 1000000);
    v.Value("num_points", num_points, "points tried", 1, 100000000);
    v.Value("max_track_window", max_track_window,
            "images before and after the finder that may see a point; 0: all", 0, 1000000);
    v.Value("pixel_sigma", pixel_sigma, "noise of the keypoints [px]", 0.0, 100.0);
    v.Value("outlier_fraction", outlier_fraction, "observations that are wrong", 0.0, 1.0);
    v.Value("point_sigma", point_sigma, "error of points, relative to the median depth", 0.0, 10.0);
    v.Value("center_sigma", center_sigma, "error of camera centres, relative to the median depth",
            0.0, 10.0);
    v.Value("rotation_sigma_deg", rotation_sigma_deg, "error of camera rotations [deg]", 0.0,
            180.0);
    v.Value("drift_rotation_deg", drift_rotation_deg, "rotation drift per image [deg]", 0.0, 180.0);
    v.Value("drift_translation", drift_translation,
            "translation drift per image, relative to the median depth", 0.0, 10.0);
    v.Value("drift_scale", drift_scale, "log-scale drift per image, standard deviation", 0.0, 1.0);
    v.Value("drift_scale_trend", drift_scale_trend, "log-scale drift per image, mean", -1.0, 1.0);
    v.Value("wrong_label_fraction", wrong_label_fraction,
            "points of planar clusters that belong to another object", 0.0, 1.0);
    v.Value("map_scale", map_scale, "map units per metre", 1e-6, 1e6);
  }
};

struct SyntheticMap {
  Reconstruction truth;     // Metres, the scene's world; the observations are the noisy ones.
  Reconstruction estimate;  // The same ids and observations; poses and points in error.
  /// In the estimate's world: one cluster per object with points on it, and for each planar object
  /// the plane fitted (least squares) to its true points; its inliers are all points of the cluster
  /// that are labelled as lying on it, wrong ones included.
  SemanticMap semantics;
  std::map<PointId, int> object_of_point;  // The truth: SceneObject::id.
  std::map<PointId, bool> on_plane;        // The truth: on its object's plane, if that has one.
  std::map<ClusterId, int> object_of_cluster;
  std::map<PlaneId, Plane> true_planes;  // In the scene's world [m].
};

/// Points are found by casting rays through random pixels (so near and large surfaces get more),
/// projected into every image with an exact visibility test, and disturbed as `options` say. Image
/// i has ImageId(i + 1), name "frame-%06d.png" by its frame number. Deterministic in (scene, seed,
/// options) for any number of threads.
SyntheticMap MakeSyntheticMap(const Scene& scene, uint64_t seed, const SyntheticMapOptions& options,
                              int num_threads = 1);

/// As above on MakeScene(scene_name, seed).
SyntheticMap MakeSyntheticMap(const std::string& scene_name, uint64_t seed,
                              const SyntheticMapOptions& options, int num_threads = 1);

/// Least-squares plane through points (at least three), normal towards `viewpoint`.
Plane FitPlaneToPoints(const std::vector<Eigen::Vector3d>& points,
                       const Eigen::Vector3d& viewpoint);

}  // namespace s3lam
