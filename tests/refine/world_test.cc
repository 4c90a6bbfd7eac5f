#include <gtest/gtest.h>

#include "refine/refine_fixture.h"

namespace s3lam::refine {
namespace {

/// A place on the Earth as UTM has it [m].
const Eigen::Vector3d kFarAway(451234.5, 5432109.25, 312.0);

/// The desk with all its frames, shifted.
Input InputAt(const SyntheticMap& map, const Eigen::Vector3d& place) {
  Input input = MakeInput(map);
  const Similarity3 shift{1.0, Eigen::Quaterniond::Identity(), place};
  TransformReconstruction(shift, input.model);
  for (auto& [id, cluster] : input.semantics.clusters) cluster.centroid_in_world += place;
  for (auto& [id, surface] : input.semantics.planes) {
    surface.plane_in_world = TransformPlane(shift, surface.plane_in_world);
    surface.centroid_in_world += place;
  }
  for (const auto& [id, image] : input.model.images) {
    input.image_times_s.push_back(static_cast<double>(id.value()));
    input.frames.push_back({input.image_times_s.back(), image.cam_from_world.Inverse()});
  }
  return input;
}

TEST(RefineWorld, AMapFarFromTheOriginIsRefinedAsOneNearIt) {
  const SyntheticMap map = MakeDeskMap();
  Output near;
  Output far;
  const Report report_near = refine::Run(Options(), InputAt(map, Eigen::Vector3d::Zero()), near);
  const Report report_far = refine::Run(Options(), InputAt(map, kFarAway), far);
  EXPECT_EQ(report_far.num_images_in_use, report_near.num_images_in_use);
  EXPECT_NEAR(AlignedCenterError(far.model, map.truth), AlignedCenterError(near.model, map.truth),
              1e-5);
  CheckSemanticMap(far.semantics, far.model, "output");
  EXPECT_EQ(far.semantics.planes.size(), near.semantics.planes.size());
  for (const auto& [id, image] : near.model.images) {
    EXPECT_LT((far.model.images.at(id).cam_from_world.CenterInB() -
               image.cam_from_world.CenterInB() - kFarAway)
                  .norm(),
              1e-5);
  }
  for (size_t i = 0; i < near.frames.size(); ++i) {
    EXPECT_LT((far.frames[i].world_from_camera.translation -
               near.frames[i].world_from_camera.translation - kFarAway)
                  .norm(),
              1e-5);
  }
}

TEST(RefineWorld, WhatIsHeldFarFromTheOriginStaysToTheLastBit) {
  const SyntheticMap map = MakeDeskMap();
  Input input = InputAt(map, kFarAway);
  const ImageId held = std::next(input.model.images.begin(), 5)->first;
  input.constraints.constant_images.insert(held);
  for (const auto& [id, point] : input.model.points) {
    if (id.value() % 7 == 0) input.constraints.constant_points.insert(id);
  }
  Output output;
  refine::Run(Options(), input, output);
  const Rigid3& before = input.model.images.at(held).cam_from_world;
  const Rigid3& after = output.model.images.at(held).cam_from_world;
  EXPECT_EQ(after.translation, before.translation);
  EXPECT_EQ(after.rotation.coeffs(), before.rotation.coeffs());
  for (const PointId id : input.constraints.constant_points) {
    ASSERT_TRUE(output.model.points.contains(id));
    EXPECT_EQ(output.model.points.at(id).xyz, input.model.points.at(id).xyz);
  }
  EXPECT_EQ(output.semantics.model_fingerprint, FingerprintOfModel(output.model));
}

TEST(RefineWorld, PriorsMayBeFarFromTheOrigin) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  Reconstruction truth = map.truth;
  TransformReconstruction({1.0, Eigen::Quaterniond::Identity(), kFarAway}, truth);
  for (const auto& [id, image] : truth.images) {
    input.constraints.pose_priors.push_back({id, image.cam_from_world, 1e-3, 1e-3});
  }
  Output output;
  const Report report = refine::Run(Options(), input, output);
  EXPECT_EQ(report.num_images_in_use, truth.images.size());
  EXPECT_LT(CenterError(output.model, truth), 2e-3);
}

}  // namespace
}  // namespace s3lam::refine
