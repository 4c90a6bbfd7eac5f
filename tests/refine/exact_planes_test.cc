#include "s3lam/refine/exact_planes.h"

#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

#include "refine/refine_fixture.h"
#include "s3lam/base/rng.h"
#include "s3lam/refine/exact_plane_cost.h"
#include "support/test_scene.h"

namespace s3lam::refine {
namespace {

AnchoredPlane SomePlane() {
  return AnchoredPlane::FromPlane({Eigen::Vector3d(0.1, -0.2, 1.0).normalized(), -5.0},
                                  Eigen::Vector3d(0.3, 0.1, 4.8));
}

TEST(ExactPlaneCost, ThePointIsOnThePlaneHoweverThePlaneTurns) {
  const AnchoredPlane plane = SomePlane();
  const PlaneFrame frame = PlaneFrame::Of(plane);
  const Eigen::Vector3d point = plane.PlaneInWorld().Project({0.7, -0.4, 5.5});
  const Eigen::Vector2d coordinates = frame.Coordinates(point);
  Eigen::Vector3d again;
  ASSERT_TRUE(PointInPlane(frame, plane.parameters.data(), coordinates.data(), &again));
  EXPECT_LT((again - point).norm(), 1e-12);
  AnchoredPlane turned = plane;
  turned.parameters.head<3>() = Eigen::Vector3d(0.4, 0.2, 0.8).normalized();
  turned.parameters[3] = 0.3;
  ASSERT_TRUE(PointInPlane(frame, turned.parameters.data(), coordinates.data(), &again));
  EXPECT_NEAR(turned.PlaneInWorld().SignedDistance(again), 0.0, 1e-12);
  turned.parameters.head<3>() = frame.e1;
  EXPECT_FALSE(PointInPlane(frame, turned.parameters.data(), coordinates.data(), &again));
}

TEST(ExactPlaneCost, GradientAgreesWithNumericDerivative) {
  const AnchoredPlane plane = SomePlane();
  const PlaneFrame frame = PlaneFrame::Of(plane);
  Eigen::Vector4d moved = plane.parameters;
  moved.head<3>() = (moved.head<3>() + Eigen::Vector3d(0.1, 0.05, 0.0)).normalized();
  moved[3] += 0.02;
  const PoseBlock pose =
      ToPoseBlock({QuaternionFromRotationVector({0.05, -0.1, 0.2}), {0.1, 0.2, -0.3}});
  const Eigen::Vector2d coordinates(0.4, -0.3);
  const PoseManifold pose_manifold;
  const AnchoredPlaneManifold plane_manifold;
  for (int i = 0; i < kNumCameraModels; ++i) {
    const auto model = static_cast<CameraModel>(i);
    const Camera camera = testing::MakeTestCamera(model);
    const ExactPlaneReprojectionCost cost(model, {300.0, 200.0}, 0.8, frame);
    const std::vector<const ceres::Manifold*> manifolds{&pose_manifold, nullptr, &plane_manifold,
                                                        nullptr};
    ceres::NumericDiffOptions options;
    options.ridders_relative_initial_step_size = 1e-3;
    const ceres::GradientChecker checker(&cost, &manifolds, options);
    const double* blocks[] = {pose.data(), coordinates.data(), moved.data(), camera.params.data()};
    ceres::GradientChecker::ProbeResults results;
    checker.Probe(blocks, 1e-6, &results);
    ASSERT_TRUE(results.return_value);
    for (size_t b = 0; b < 3; ++b) {
      const auto& numeric = results.local_numeric_jacobians[b];
      ASSERT_GT(numeric.norm(), 0.0);
      EXPECT_LT((results.local_jacobians[b] - numeric).norm(), 1e-6 * numeric.norm())
          << i << " block " << b;
    }
  }
}

TEST(RefineExactPlanes, PointsOfCertainPlanesAreOnThemAndTheResultIsGood) {
  const SyntheticMap map = MakeDeskMap();
  Output plain;
  Output exact;
  refine::Run(MakeOptions({"planes.mode=off"}), MakeInput(map), plain);
  const Report report = refine::Run(MakeOptions({"planes.mode=hard"}), MakeInput(map), exact);
  EXPECT_GT(report.num_exact_planes, 0u);
  EXPECT_GT(report.num_exact_points, 50u);
  EXPECT_EQ(report.plane_mode, "hard");
  EXPECT_LT(AlignedCenterError(exact.model, map.truth), AlignedCenterError(plain.model, map.truth));
  size_t on_planes = 0;
  for (const auto& [id, surface] : exact.semantics.planes) {
    for (const PointId point : surface.inliers) {
      const double distance =
          surface.plane_in_world.SignedDistance(exact.model.points.at(point).xyz);
      on_planes += std::abs(distance) < 1e-9;
    }
  }
  EXPECT_EQ(on_planes, report.num_exact_points);
  CheckReconstruction(exact.model, "output");
  CheckSemanticMap(exact.semantics, exact.model, "output");
}

TEST(RefineExactPlanes, WithoutOverwhelmingEvidenceItIsJoint) {
  const SyntheticMap map = MakeDeskMap();
  Output joint;
  Output hard;
  refine::Run(MakeOptions({"planes.mode=joint"}), MakeInput(map), joint);
  const Report report = refine::Run(
      MakeOptions({"planes.mode=hard", "exact_planes.min_points=100000"}), MakeInput(map), hard);
  EXPECT_EQ(report.num_exact_planes, 0u);
  EXPECT_EQ(report.num_exact_points, 0u);
  for (const auto& [id, image] : joint.model.images) {
    EXPECT_EQ(image.cam_from_world.translation,
              hard.model.images.at(id).cam_from_world.translation);
  }
}

TEST(RefineExactPlanes, WrongLabelsDoNoHarm) {
  const SyntheticMap map = MakeDeskMap({"wrong_label_fraction=0.3"});
  Output plain;
  Output exact;
  refine::Run(MakeOptions({"planes.mode=off"}), MakeInput(map), plain);
  refine::Run(MakeOptions({"planes.mode=hard"}), MakeInput(map), exact);
  EXPECT_LE(AlignedCenterError(exact.model, map.truth),
            1.05 * AlignedCenterError(plain.model, map.truth));
}

TEST(RefineExactPlanes, APointThatItsObservationsTakeOffThePlaneIsFreed) {
  const SyntheticMap map = MakeDeskMap({"point_sigma=0", "center_sigma=0", "rotation_sigma_deg=0"});
  BundleMap bundle = BuildBundleMap(map.truth);
  SelectObservations({}, 1.0, true, bundle);
  BundleProblem& problem = bundle.problem;
  // Planes through two true points; the second point is put off its true place.
  const std::vector<int> points{problem.observations.front().point,
                                problem.observations.back().point};
  std::vector<int> plane_of_point(problem.points.size(), -1);
  for (size_t k = 0; k < 2; ++k) {
    const Eigen::Vector3d& point = problem.points[points[k]];
    const Eigen::Vector3d normal = point.normalized();
    problem.planes.push_back(AnchoredPlane::FromPlane({normal, -normal.dot(point)}, point));
    plane_of_point[points[k]] = static_cast<int>(k);
  }
  problem.points[points[1]] += 0.2 * problem.points[points[1]].normalized();
  const std::vector<double> steps = StepsOffPlanes(problem, 1.0, plane_of_point);
  EXPECT_LT(steps[points[0]], 3.0);
  EXPECT_GT(steps[points[1]], 5.0);
  EXPECT_EQ(std::count_if(steps.begin(), steps.end(), [](double s) { return s > 0.0; }), 2);
}

}  // namespace
}  // namespace s3lam::refine
