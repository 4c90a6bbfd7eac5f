// What holds between planes, and which planes long surfaces are cut into.

#include "s3lam/refine/pipeline.h"

#include <gtest/gtest.h>

#include <cmath>

#include "refine/refine_fixture.h"
#include "s3lam/base/error.h"
#include "s3lam/synthetic/synthetic_map.h"

namespace s3lam::refine {
namespace {

TEST(RefineBending, LongSurfacesOfBendingClassesAreCut) {
  const SyntheticMap map = MakeDrive();
  Options options;
  options.camera_height.mode = CameraHeightMode::kOff;
  Output cut;
  const Report report = refine::Run(options, MakeInput(map), cut);
  options.bending.classes.clear();
  Output whole;
  const Report whole_report = refine::Run(options, MakeInput(map), whole);
  EXPECT_EQ(whole_report.planes.size(), map.semantics.planes.size());
  EXPECT_GT(report.planes.size(), whole_report.planes.size());
}

TEST(RefineBending, PiecesAreAsLongWhateverOtherCamerasThereAre) {
  Input input = MakeInput(MakeDrive());
  Options options;
  options.camera_height.mode = CameraHeightMode::kOff;
  Output alone;
  refine::Run(options, input, alone);
  Camera telescope = input.model.cameras.begin()->second;
  telescope.id = CameraId(99);
  telescope.params[0] *= 1000.0;
  telescope.params[1] *= 1000.0;
  input.model.cameras[telescope.id] = telescope;  // That nothing was taken with.
  Output beside;
  refine::Run(options, input, beside);
  EXPECT_EQ(alone.semantics.planes.size(), beside.semantics.planes.size());
  EXPECT_TRUE(SameBytes(alone.model, beside.model));
}

TEST(RefineRelations, ParallelAndOrthogonalPlanesComeNearerToIt) {
  const SyntheticMap map = MakeDeskMap();
  Options options;
  Output with;
  const Report report = refine::Run(options, MakeInput(map), with);
  size_t enforced = 0;
  for (const PlanePairReport& pair : report.pairs) {
    if (!pair.enforced) continue;
    ++enforced;
    EXPECT_LT(pair.deviation_deg.back(), std::max(1.0, pair.deviation_deg.front()));
  }
  EXPECT_GT(enforced, 0u);
  options.relations.enabled = false;
  Output without;
  for (const PlanePairReport& pair : refine::Run(options, MakeInput(map), without).pairs) {
    EXPECT_FALSE(pair.enforced);
  }
}

/// The map and, in the same world, the same once more, so far to the side.
Input MakeTwoPlaces(const SyntheticMap& map, const Eigen::Vector3d& shift) {
  Input input = MakeInput(map);
  Reconstruction& model = input.model;
  SemanticMap& semantics = input.semantics;
  const auto point_ids = static_cast<uint64_t>(map.estimate.points.rbegin()->first.value() + 1);
  const auto image_ids = map.estimate.images.rbegin()->first.value() + 1;
  const auto cluster_ids = map.semantics.clusters.rbegin()->first.value() + 1;
  const auto plane_ids = map.semantics.planes.rbegin()->first.value() + 1;
  const auto other_point = [&](PointId id) { return PointId(id.value() + point_ids); };
  for (auto [id, image] : map.estimate.images) {
    image.id = ImageId(id.value() + image_ids);
    image.name = "other/" + image.name;
    image.cam_from_world.translation -= image.cam_from_world.rotation * shift;
    for (Point2D& keypoint : image.points2D) {
      if (keypoint.point_id.valid()) keypoint.point_id = other_point(keypoint.point_id);
    }
    model.images.emplace(image.id, image);
  }
  for (auto [id, point] : map.estimate.points) {
    point.xyz += shift;
    for (TrackElement& element : point.track) {
      element.image_id = ImageId(element.image_id.value() + image_ids);
    }
    model.points.emplace(other_point(id), point);
  }
  for (auto [id, cluster] : map.semantics.clusters) {
    cluster.id = ClusterId(id.value() + cluster_ids);
    cluster.centroid_in_world += shift;
    for (PointId& point : cluster.points) point = other_point(point);
    semantics.clusters.emplace(cluster.id, cluster);
  }
  for (auto [id, plane] : map.semantics.planes) {
    plane.id = PlaneId(id.value() + plane_ids);
    plane.cluster_id = ClusterId(plane.cluster_id.value() + cluster_ids);
    plane.plane_in_world.offset -= plane.plane_in_world.normal.dot(shift);
    plane.centroid_in_world += shift;
    for (PointId& point : plane.inliers) point = other_point(point);
    semantics.planes.emplace(plane.id, plane);
  }
  const SemanticMap& one = map.semantics;
  for (size_t row = 0; row < one.points.size(); ++row) {
    semantics.points.push_back(other_point(one.points[row]));
    semantics.num_mask_observations.push_back(one.num_mask_observations[row]);
    const ClusterId cluster = one.cluster_of_point[row];
    semantics.cluster_of_point.push_back(cluster.valid() ? ClusterId(cluster.value() + cluster_ids)
                                                         : cluster);
  }
  semantics.distributions.conservativeResize(2 * one.distributions.rows(), Eigen::NoChange);
  semantics.distributions.bottomRows(one.distributions.rows()) = one.distributions;
  semantics.model_fingerprint = FingerprintOfModel(model);
  return input;
}

TEST(RefineRelations, PlanesOfDifferentPlacesHaveNone) {
  const SyntheticMap map = MakeDeskMap();
  const PlaneId last_of_first = map.semantics.planes.rbegin()->first;
  const auto count = [&](double shift) {
    std::pair<int, int> within_and_between;
    Output output;
    Input input = MakeTwoPlaces(map, {shift, 0.0, 0.0});
    for (const auto& [id, image] : input.model.images) {  // Nothing else ties the two places.
      input.constraints.constant_images.insert(id);
    }
    for (const PlanePairReport& pair : refine::Run(Options(), input, output).pairs) {
      if (!pair.enforced) continue;
      const bool is_within = (pair.a > last_of_first) == (pair.b > last_of_first);
      ++(is_within ? within_and_between.first : within_and_between.second);
    }
    return within_and_between;
  };
  const auto [within_near, between_near] = count(1.0);
  EXPECT_GT(within_near, 0);
  EXPECT_GT(between_near, 0);
  const auto [within_far, between_far] = count(100.0);
  EXPECT_GT(within_far, 0);
  EXPECT_EQ(between_far, 0);
}

/// The two largest parallel planes of the map whose distance is not small.
std::pair<PlaneId, PlaneId> ParallelPair(const SyntheticMap& map) {
  std::pair<PlaneId, PlaneId> best;
  size_t most = 0;
  for (const auto& [a, surface_a] : map.semantics.planes) {
    for (const auto& [b, surface_b] : map.semantics.planes) {
      const Plane& plane_a = map.true_planes.at(a);
      const Plane& plane_b = map.true_planes.at(b);
      if (b <= a || PlaneAngle(plane_a, plane_b) > 1e-6) continue;
      if (std::abs(StepBetween(plane_a, plane_b, Eigen::Vector3d::Zero())) < 0.1) continue;
      const size_t points = std::min(surface_a.inliers.size(), surface_b.inliers.size());
      if (points <= most) continue;
      most = points;
      best = {a, b};
    }
  }
  return best;
}

TEST(RefineRelations, PlanesKeepTheDistanceThatIsKnown) {
  const SyntheticMap map = MakeDeskMap();
  const auto [a, b] = ParallelPair(map);
  ASSERT_TRUE(a.valid());
  const double truth =
      std::abs(StepBetween(map.true_planes.at(a), map.true_planes.at(b), Eigen::Vector3d::Zero()));
  for (const double factor : {1.0, 1.02}) {  // What is said is done, true or not.
    Input input = MakeInput(map);
    input.constraints.plane_distances = {{a, b, factor * truth, 1e-5 * truth}};
    Output output;
    const Report report = refine::Run(Options(), input, output);
    ASSERT_EQ(report.distances.size(), 1u);
    EXPECT_EQ(report.distances[0].known, factor * truth);
    ASSERT_EQ(report.distances[0].measured.size(), report.arms.size());
    const Plane& plane_a = output.semantics.planes.at(a).plane_in_world;
    const Plane& plane_b = output.semantics.planes.at(b).plane_in_world;
    EXPECT_NEAR(report.distances[0].measured.back(), factor * truth, 0.01 * truth);
    EXPECT_LT(PlaneAngle(plane_a, plane_b), 0.01);
  }
}

TEST(RefineRelations, DistancesOfPlanesThatCannotHaveOneAreRefused) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  Output output;
  input.constraints.plane_distances = {{PlaneId(0), PlaneId(987), 1.0, 0.01}};
  EXPECT_THROW(refine::Run(Options(), input, output), InputError);
  for (const auto& [a, plane_a] : map.true_planes) {
    for (const auto& [b, plane_b] : map.true_planes) {
      if (PlaneAngle(plane_a, plane_b) < 1.0) continue;
      input.constraints.plane_distances = {{a, b, 1.0, 0.01}};
      EXPECT_THROW(refine::Run(Options(), input, output), InputError);
      return;
    }
  }
  FAIL() << "no planes at an angle";
}

TEST(RefineRelations, DistancesThatNothingStandsForAreFound) {
  PlaneModel model;
  for (uint32_t id : {4, 7, 9}) {
    model.planes.emplace_back();
    model.planes.back().id = PlaneId(id);
  }
  BundleProblem problem;
  problem.relations.push_back({PlaneRelation::kAtDistance, 0, 1});
  problem.relations.push_back({PlaneRelation::kParallel, 0, 2});
  const std::vector<PlaneDistance> known{{PlaneId(7), PlaneId(4), 1.0, 0.1},
                                         {PlaneId(4), PlaneId(9), 1.0, 0.1}};
  const auto unused = UnusedDistances(known, model, problem);
  ASSERT_EQ(unused.size(), 1u);
  EXPECT_EQ(unused.front().b, PlaneId(9));
}

// ---- degenerate input: a clear error or a sound result ----

}  // namespace
}  // namespace s3lam::refine
