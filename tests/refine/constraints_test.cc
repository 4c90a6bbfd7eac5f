#include "s3lam/refine/constraints.h"

#include <gtest/gtest.h>

#include "refine/refine_fixture.h"
#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"
#include "s3lam/refine/pose_prior_cost.h"

namespace s3lam::refine {
namespace {

void ExpectSamePose(const Rigid3& a, const Rigid3& b) {
  EXPECT_EQ(a.translation, b.translation);
  EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
}

TEST(PosePriorCost, JacobianIsThatOfTheResiduals) {
  const Rigid3 prior{QuaternionFromRotationVector({0.3, -0.2, 0.9}), {1.0, 2.0, -0.5}};
  const PoseManifold manifold;
  for (const double angle : {1e-7, 0.3, 1.2}) {
    const Rigid3 pose{
        (QuaternionFromRotationVector(angle * Eigen::Vector3d(0.6, 0.0, 0.8)) * prior.rotation)
            .normalized(),
        {0.7, 2.5, 0.1}};
    const PosePriorCost cost(prior, 0.2, 0.05);
    const PoseBlock block = ToPoseBlock(pose);
    const double* parameters[] = {block.data()};
    Eigen::Matrix<double, 6, 1> residuals;
    Eigen::Matrix<double, 6, 7, Eigen::RowMajor> jacobian;
    double* jacobians[] = {jacobian.data()};
    ASSERT_TRUE(cost.Evaluate(parameters, residuals.data(), jacobians));
    Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
    manifold.PlusJacobian(block.data(), plus.data());
    const Eigen::Matrix<double, 6, 6> by_delta = jacobian * plus;
    for (int i = 0; i < 6; ++i) {
      constexpr double kStep = 1e-6;
      Eigen::Matrix<double, 6, 1> ends[2];
      for (const int side : {0, 1}) {
        Eigen::Matrix<double, 6, 1> delta = Eigen::Matrix<double, 6, 1>::Zero();
        delta[i] = side == 0 ? -kStep : kStep;
        PoseBlock moved;
        manifold.Plus(block.data(), delta.data(), moved.data());
        const double* moved_parameters[] = {moved.data()};
        ASSERT_TRUE(cost.Evaluate(moved_parameters, ends[side].data(), nullptr));
      }
      EXPECT_LT((by_delta.col(i) - (ends[1] - ends[0]) / (2.0 * kStep)).norm(), 1e-5) << i;
    }
  }
}

TEST(RefineConstraints, ConstantImagesAndPointsStayToTheLastBit) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  const std::vector<ImageId> images{std::next(map.estimate.images.begin(), 3)->first,
                                    std::next(map.estimate.images.begin(), 9)->first};
  input.constraints.constant_images.insert(images.begin(), images.end());
  for (const auto& [id, point] : map.estimate.points) {
    if (id.value() % 7 == 0) input.constraints.constant_points.insert(id);
  }
  Output output;
  const Report report = refine::Run(MakeOptions({}), input, output);
  for (const ImageId id : images) {
    ExpectSamePose(output.model.images.at(id).cam_from_world,
                   map.estimate.images.at(id).cam_from_world);
  }
  const ImageId first = map.estimate.images.begin()->first;
  EXPECT_NE(output.model.images.at(first).cam_from_world.translation,
            map.estimate.images.at(first).cam_from_world.translation);
  size_t constant = 0;
  for (const PointId id : input.constraints.constant_points) {
    const auto it = output.model.points.find(id);
    if (it == output.model.points.end()) continue;
    EXPECT_EQ(it->second.xyz, map.estimate.points.at(id).xyz);
    ++constant;
  }
  EXPECT_GT(constant, 50u);
  EXPECT_GT(report.arms.back().pose_moved_max, 0.0);
}

TEST(RefineConstraints, AConstantPointStaysWithoutItsObservations) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  const PointId id = input.model.points.begin()->first;
  input.constraints.constant_points.insert(id);
  for (const TrackElement& element : input.model.points.at(id).track) {
    input.model.images.at(element.image_id).points2D[element.point2D_index].xy.array() += 100.0;
  }
  Output output;
  refine::Run(MakeOptions({}), input, output);
  ASSERT_TRUE(output.model.points.contains(id));
  EXPECT_EQ(output.model.points.at(id).xyz, input.model.points.at(id).xyz);
  EXPECT_TRUE(output.model.points.at(id).track.empty());
}

TEST(RefineConstraints, MembershipOfConstantPointsSettles) {
  const SyntheticMap map = MakeDeskMap({"center_sigma=0", "rotation_sigma_deg=0"});
  Input input = MakeInput(map);
  for (const auto& [id, point] : map.estimate.points) input.constraints.constant_points.insert(id);
  const Options options;
  BundleMap bundle = BuildBundleMap(input.model);
  SelectObservations(options.outliers, 1.0, true, bundle);
  ApplyConstraints(input.constraints, bundle);
  PlaneModel planes = BuildPlaneModel(options.planes.membership, input.semantics, bundle);
  FreezeUncertainty(bundle.problem, 1.0, planes);
  InitialisePlanes(options.planes, 1.0, planes, bundle.problem);
  const auto assign = [&] {
    return AssignPoints(options.planes.membership, options.planes.sigma, options.solver, planes,
                        bundle.problem);
  };
  EXPECT_GT(assign().members, 100u);
  EXPECT_EQ(assign().changed, 0u);
}

TEST(RefineConstraints, GivenPosesCanBeKeptWhileThePointsAreAdjusted) {
  const SyntheticMap map = MakeDeskMap({"center_sigma=0", "rotation_sigma_deg=0"});
  Input input = MakeInput(map);
  for (const auto& [id, image] : map.estimate.images) input.constraints.constant_images.insert(id);
  Output output;
  const Report report = refine::Run(MakeOptions({"planes.mode=off"}), input, output);
  for (const auto& [id, image] : output.model.images) {
    ExpectSamePose(image.cam_from_world, map.estimate.images.at(id).cam_from_world);
  }
  EXPECT_GT(report.arms.back().point_moved_median, 0.0);
  EXPECT_LT(report.arms.back().reprojection_rms_px, report.arms.front().reprojection_rms_px);
}

/// The truth with a normal deviation of the sigmas.
std::vector<PosePrior> PriorsNearTruth(const SyntheticMap& map, size_t step, double sigma_position,
                                       double sigma_rotation) {
  Rng rng(17);
  std::vector<PosePrior> priors;
  size_t i = 0;
  for (const auto& [id, image] : map.truth.images) {
    if (i++ % step != 0) continue;
    const auto noise = [&](double sigma) {
      return Eigen::Vector3d(rng.Gaussian(0.0, sigma), rng.Gaussian(0.0, sigma),
                             rng.Gaussian(0.0, sigma));
    };
    Rigid3 world_from_camera = image.cam_from_world.Inverse();
    world_from_camera.translation += noise(sigma_position);
    world_from_camera.rotation =
        (world_from_camera.rotation * QuaternionFromRotationVector(noise(sigma_rotation)))
            .normalized();
    priors.push_back({id, world_from_camera.Inverse(), sigma_position, sigma_rotation});
  }
  return priors;
}

TEST(RefineConstraints, PriorsPutTheMapWhereTheyAre) {
  const SyntheticMap map = MakeDeskMap();
  const Similarity3 elsewhere{
      1.02, QuaternionFromRotationVector({0.0, 0.02, 0.01}), {0.05, -0.02, 0.03}};
  Input input = MakeInput(map);
  TransformReconstruction(elsewhere, input.model);
  input.semantics = {};
  Output without;
  refine::Run(MakeOptions({}), input, without);
  input.constraints.pose_priors = PriorsNearTruth(map, 3, 1e-3, 1e-3);
  Output with;
  const Report report = refine::Run(MakeOptions({}), input, with);
  EXPECT_GT(CenterError(without.model, map.truth), 0.02);
  EXPECT_LT(CenterError(with.model, map.truth), 2e-3);
  EXPECT_EQ(report.gauge_scale_change, 0.0);
  // Positions alone are enough where they are not on a line.
  for (PosePrior& prior : input.constraints.pose_priors) prior.sigma_rotation = 0.0;
  Output positions;
  refine::Run(MakeOptions({}), input, positions);
  EXPECT_LT(CenterError(positions.model, map.truth), 4e-3);
}

TEST(RefineConstraints, TheMapIsBroughtIntoAnotherWorldOfThePriors) {
  const SyntheticMap map = MakeDeskMap();
  const Similarity3 other{
      40.0, QuaternionFromRotationVector({0.4, -1.1, 2.0}), {500.0, -80.0, 30.0}};
  Reconstruction truth = map.truth;
  TransformReconstruction(other, truth);
  Output in_own_world;
  refine::Run(Options(), MakeInput(map), in_own_world);
  for (const size_t step : {size_t{1}, size_t{8}}) {  // All; two, which are always on a line.
    Input input = MakeInput(map);
    for (const auto& [id, image] : map.estimate.images) {
      input.image_times_s.push_back(static_cast<double>(id.value()));
      input.frames.push_back({input.image_times_s.back(), image.cam_from_world.Inverse()});
    }
    input.constraints.pose_priors = PriorsNearTruth(map, step, 1e-3, 1e-3);
    for (PosePrior& prior : input.constraints.pose_priors) {
      prior.cam_from_world = TransformCameraPose(other, prior.cam_from_world);
      prior.sigma_position *= other.scale;
    }
    Output output;
    const Report report = refine::Run(Options(), input, output);
    EXPECT_LT(CenterError(output.model, truth) / other.scale, 4e-3) << step;
    EXPECT_GT(report.planes.size(), 3u);
    CheckSemanticMap(output.semantics, output.model, "output");
    for (size_t i = 0; i < output.frames.size(); ++i) {
      EXPECT_LT((output.frames[i].world_from_camera.translation -
                 output.keyframes[i].world_from_camera.translation)
                    .norm(),
                1e-9 * other.scale);
    }
    for (const auto& [id, surface] : in_own_world.semantics.planes) {
      ASSERT_TRUE(output.semantics.planes.contains(id));
      EXPECT_LT(PlaneAngle(output.semantics.planes.at(id).plane_in_world,
                           TransformPlane(other, surface.plane_in_world)),
                0.05);
    }
  }
}

TEST(RefineConstraints, PriorsThatLeaveFreedomsOpenAreRefused) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  input.constraints.pose_priors = PriorsNearTruth(map, 100, 1e-3, 1e-3);
  ASSERT_EQ(input.constraints.pose_priors.size(), 1u);
  Output output;
  EXPECT_THROW(refine::Run(MakeOptions({}), input, output), InputError);
  input.constraints.pose_priors = PriorsNearTruth(map, 8, 1e-3, 0.0);
  ASSERT_EQ(input.constraints.pose_priors.size(), 2u);
  EXPECT_THROW(refine::Run(MakeOptions({}), input, output), InputError);
}

TEST(RefineConstraints, AConstantImageTakesTheFirstOnesPlace) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  const ImageId id = std::next(map.estimate.images.begin(), 5)->first;
  input.constraints.constant_images.insert(id);
  Output output;
  const Report report = refine::Run(MakeOptions({"planes.mode=off"}), input, output);
  ExpectSamePose(output.model.images.at(id).cam_from_world,
                 map.estimate.images.at(id).cam_from_world);
  EXPECT_LT(std::abs(report.gauge_scale_change), 1e-9);
  EXPECT_LT(AlignedCenterError(output.model, map.truth),
            0.5 * AlignedCenterError(map.estimate, map.truth));
}

}  // namespace
}  // namespace s3lam::refine
