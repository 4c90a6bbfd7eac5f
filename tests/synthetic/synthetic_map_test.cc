#include "s3lam/synthetic/synthetic_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "s3lam/geometry/alignment.h"

namespace s3lam {
namespace {

SyntheticMapOptions Small() {
  SyntheticMapOptions options;
  options.num_images = 48;
  options.num_points = 1500;
  return options;
}

TEST(SyntheticMap, IsConsistentInEveryScene) {
  SyntheticMapOptions options = Small();
  options.num_points = 4000;
  for (const std::string& name : SceneNames()) {
    const SyntheticMap map = MakeSyntheticMap(name, 1, options);
    ASSERT_NO_THROW(CheckReconstruction(map.truth, name));
    ASSERT_NO_THROW(CheckReconstruction(map.estimate, name));
    ASSERT_NO_THROW(CheckSemanticMap(map.semantics, map.estimate, name));
    EXPECT_GT(map.truth.points.size(), 300u) << name;
    EXPECT_GT(map.semantics.planes.size(), 1u) << name;
    EXPECT_EQ(map.semantics.planes.size(), map.true_planes.size());
  }
}

TEST(SyntheticMap, TruthReprojectsWithTheStatedNoise) {
  SyntheticMapOptions options = Small();
  options.pixel_sigma = 0.7;
  const SyntheticMap map = MakeSyntheticMap("room", 2, options);
  const ReprojectionStatistics statistics = ComputeReprojectionStatistics(map.truth);
  EXPECT_EQ(statistics.num_behind, 0u);
  EXPECT_NEAR(statistics.rms_px, 0.7 * std::sqrt(2.0), 0.05);
  options.pixel_sigma = 0.0;
  EXPECT_LT(ComputeReprojectionStatistics(MakeSyntheticMap("room", 2, options).truth).rms_px, 1e-6);
}

TEST(SyntheticMap, IsTheSameForAnyNumberOfThreads) {
  SyntheticMapOptions options = Small();
  options.drift_scale = 0.01;
  options.wrong_label_fraction = 0.2;
  const SyntheticMap one = MakeSyntheticMap("desk", 5, options, 1);
  const SyntheticMap three = MakeSyntheticMap("desk", 5, options, 3);
  EXPECT_EQ(FingerprintOfModel(one.estimate), FingerprintOfModel(three.estimate));
  EXPECT_EQ(one.semantics.cluster_of_point, three.semantics.cluster_of_point);
  EXPECT_NE(FingerprintOfModel(one.estimate),
            FingerprintOfModel(MakeSyntheticMap("desk", 6, options, 1).estimate));
}

TEST(SyntheticMap, PointsOfPlanesLieOnThem) {
  const SyntheticMap map = MakeSyntheticMap("room", 3, Small());
  ASSERT_GT(map.semantics.planes.size(), 3u);
  for (const auto& [id, surface] : map.semantics.planes) {
    const Plane& plane = map.true_planes.at(id);
    size_t on_plane = 0;
    for (const PointId point : surface.inliers) {
      EXPECT_LT(std::abs(plane.SignedDistance(map.truth.points.at(point).xyz)), 1e-5);
      ++on_plane;
    }
    EXPECT_GE(on_plane, 30u);
    // Without errors in the estimate the fitted plane is the true one.
    EXPECT_LT(PlaneAngle(plane, surface.plane_in_world), 1e-6);
  }
}

TEST(SyntheticMap, MapScaleAloneIsASimilarity) {
  SyntheticMapOptions options = Small();
  options.map_scale = 0.2;
  const SyntheticMap map = MakeSyntheticMap("room", 4, options);
  EXPECT_NEAR(ComputeReprojectionStatistics(map.estimate).rms_px,
              ComputeReprojectionStatistics(map.truth).rms_px, 1e-9);
  const ScenePoint& before = map.truth.points.begin()->second;
  const ScenePoint& after = map.estimate.points.begin()->second;
  EXPECT_LT((0.2 * before.xyz - after.xyz).norm(), 1e-9);
}

double DriftOfCenters(const SyntheticMap& map) {
  std::vector<Eigen::Vector3d> truth;
  std::vector<Eigen::Vector3d> estimate;
  for (const auto& [id, image] : map.truth.images) {
    truth.push_back(image.cam_from_world.CenterInB());
    estimate.push_back(map.estimate.images.at(id).cam_from_world.CenterInB());
  }
  const std::optional<Similarity3> alignment = AlignPoints(truth, estimate);
  double sum = 0.0;
  for (size_t i = 0; i < truth.size(); ++i) {
    sum += (truth[i] - *alignment * estimate[i]).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(truth.size()));
}

TEST(SyntheticMap, DriftBendsTheTrajectoryMoreTheStrongerItIs) {
  double last = -1e-9;
  for (const double drift : {0.0, 0.005, 0.02, 0.08}) {
    SyntheticMapOptions options = Small();
    options.drift_scale_trend = drift;
    const double error = DriftOfCenters(MakeSyntheticMap("room", 7, options));
    EXPECT_GT(error, last);
    last = error;
  }
}

TEST(SyntheticMap, WrongLabelsHaveTheStatedShare) {
  SyntheticMapOptions options = Small();
  options.num_points = 3000;
  options.wrong_label_fraction = 0.3;
  const SyntheticMap map = MakeSyntheticMap("room", 8, options);
  size_t wrong = 0;
  size_t all = 0;
  for (const auto& [id, surface] : map.semantics.planes) {
    const int object = map.object_of_cluster.at(surface.cluster_id);
    for (const PointId point : map.semantics.clusters.at(surface.cluster_id).points) {
      wrong += map.object_of_point.at(point) != object ? 1 : 0;
      ++all;
    }
  }
  EXPECT_NEAR(static_cast<double>(wrong) / static_cast<double>(all), 0.3, 0.05);
}

TEST(SyntheticMap, OutliersHaveTheStatedShare) {
  SyntheticMapOptions options = Small();
  options.outlier_fraction = 0.1;
  options.pixel_sigma = 0.1;
  const SyntheticMap map = MakeSyntheticMap("desk", 9, options);
  size_t far = 0;
  size_t all = 0;
  for (const auto& [id, image] : map.truth.images) {
    for (const Point2D& point : image.points2D) {
      const auto xy = map.truth.CameraOf(image).ImageFromCamera(
          image.cam_from_world * map.truth.points.at(point.point_id).xyz);
      ASSERT_TRUE(xy.has_value());
      far += (*xy - point.xy).norm() > 4.0 ? 1 : 0;
      ++all;
    }
  }
  EXPECT_NEAR(static_cast<double>(far) / static_cast<double>(all), 0.1, 0.02);
}

}  // namespace
}  // namespace s3lam
