#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "s3lam/base/options_json.h"
#include "s3lam/geometry/alignment.h"
#include "s3lam/refine/pipeline.h"
#include "s3lam/synthetic/synthetic_map.h"

namespace s3lam::refine {

/// A small noisy map of a desk.
inline SyntheticMap MakeDeskMap(const std::vector<std::string>& assignments = {}) {
  SyntheticMapOptions options;
  options.num_images = 16;
  options.num_points = 700;
  options.max_track_window = 4;
  options.pixel_sigma = 0.7;
  options.point_sigma = 0.005;
  options.center_sigma = 0.003;
  options.rotation_sigma_deg = 0.1;
  for (const std::string& assignment : assignments) SetOption(assignment, options);
  return MakeSyntheticMap("desk", 3, options);
}

/// A drive whose scale drifts slowly: each image sees only its neighbours' points.
inline SyntheticMap MakeDrive() {
  SyntheticMapOptions options;
  options.num_images = 40;
  options.num_points = 2000;
  options.max_track_window = 2;
  options.pixel_sigma = 1.5;
  options.drift_scale = 0.01;
  return MakeSyntheticMap("street", 1, options);
}

inline Input MakeInput(const SyntheticMap& map) {
  Input input;
  input.model = map.estimate;
  input.semantics = map.semantics;
  return input;
}

inline Options MakeOptions(const std::vector<std::string>& assignments) {
  Options options;
  for (const std::string& assignment : assignments) SetOption(assignment, options);
  return options;
}

/// RMS distance of the camera centres from the true ones, in the world as it is [m].
inline double CenterError(const Reconstruction& model, const Reconstruction& truth) {
  double sum = 0.0;
  for (const auto& [id, image] : truth.images) {
    sum += (model.images.at(id).cam_from_world.CenterInB() - image.cam_from_world.CenterInB())
               .squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(truth.images.size()));
}

/// The same after Sim(3) alignment.
inline double AlignedCenterError(const Reconstruction& model, const Reconstruction& truth) {
  std::vector<Eigen::Vector3d> a;
  std::vector<Eigen::Vector3d> b;
  for (const auto& [id, image] : truth.images) {
    a.push_back(image.cam_from_world.CenterInB());
    b.push_back(model.images.at(id).cam_from_world.CenterInB());
  }
  const auto a_from_b = AlignPoints(a, b);
  EXPECT_TRUE(a_from_b.has_value());
  double sum = 0.0;
  for (size_t i = 0; i < a.size(); ++i) sum += (a[i] - *a_from_b * b[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(a.size()));
}

inline Options WithMode(PlaneMode mode) {
  Options options;
  options.planes.mode = mode;
  return options;
}

/// Camera centres of the images that `reference` has.
inline std::vector<Eigen::Vector3d> Centers(const Reconstruction& model,
                                            const Reconstruction& reference) {
  std::vector<Eigen::Vector3d> centers;
  for (const auto& [id, image] : reference.images) {
    centers.push_back(model.images.at(id).cam_from_world.CenterInB());
  }
  return centers;
}

/// Poses and points, to the bit.
inline bool SameBytes(const Reconstruction& a, const Reconstruction& b) {
  if (a.points.size() != b.points.size() || a.images.size() != b.images.size()) return false;
  for (const auto& [id, image] : a.images) {
    const Rigid3& other = b.images.at(id).cam_from_world;
    if (image.cam_from_world.rotation.coeffs() != other.rotation.coeffs()) return false;
    if (image.cam_from_world.translation != other.translation) return false;
  }
  for (const auto& [id, point] : a.points) {
    if (!b.points.contains(id) || point.xyz != b.points.at(id).xyz) return false;
  }
  return true;
}

}  // namespace s3lam::refine
