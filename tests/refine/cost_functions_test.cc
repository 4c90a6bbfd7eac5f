#include "s3lam/refine/cost_functions.h"

#include <ceres/autodiff_cost_function.h>
#include <ceres/gradient_checker.h>
#include <ceres/rotation.h>
#include <gtest/gtest.h>

#include "s3lam/base/rng.h"
#include "s3lam/refine/manifolds.h"
#include "s3lam/refine/projection.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using Vectors = std::vector<std::vector<double>>;

std::vector<const double*> Pointers(const Vectors& blocks) {
  std::vector<const double*> pointers;
  for (const auto& block : blocks) pointers.push_back(block.data());
  return pointers;
}

/// Analytic against numeric derivatives, through the manifolds: each block's to 1e-6 of its size (a
/// single entry may be zero where the numeric one is rounding noise).
void ExpectGradient(const ceres::CostFunction& cost, const Vectors& blocks,
                    const std::vector<const ceres::Manifold*>& manifolds) {
  ceres::NumericDiffOptions options;
  options.ridders_relative_initial_step_size = 1e-3;
  const ceres::GradientChecker checker(&cost, &manifolds, options);
  ceres::GradientChecker::ProbeResults results;
  checker.Probe(Pointers(blocks).data(), 1e-6, &results);
  ASSERT_TRUE(results.return_value);
  ASSERT_EQ(results.local_jacobians.size(), blocks.size());
  for (size_t i = 0; i < blocks.size(); ++i) {
    const auto& numeric = results.local_numeric_jacobians[i];
    ASSERT_GT(numeric.norm(), 0.0);
    EXPECT_LT((results.local_jacobians[i] - numeric).norm(), 1e-6 * numeric.norm())
        << "block " << i << "\n"
        << results.error_log;
  }
}

std::vector<double> PoseVector(Rng& rng) {
  const Eigen::Vector3d omega(rng.Gaussian(0.0, 0.6), rng.Gaussian(0.0, 0.6), rng.Gaussian());
  const PoseBlock block = ToPoseBlock(
      {QuaternionFromRotationVector(omega), {rng.Gaussian(), rng.Gaussian(), rng.Gaussian()}});
  return {block.begin(), block.end()};
}

/// A point that the camera sees at (x, y, 1) * depth.
std::vector<double> PointBefore(const std::vector<double>& pose, double x, double y, double depth) {
  const Eigen::Vector3d point =
      FromPoseBlock(pose.data()).Inverse() * (depth * Eigen::Vector3d(x, y, 1.0));
  return {point.begin(), point.end()};
}

std::vector<double> PlaneVector(Rng& rng) {
  Eigen::Vector3d normal(rng.Gaussian(), rng.Gaussian(), rng.Gaussian());
  normal.normalize();
  return {normal.x(), normal.y(), normal.z(), rng.Gaussian()};
}

class ReprojectionCostTest : public ::testing::TestWithParam<int> {};

TEST_P(ReprojectionCostTest, GradientAgreesWithNumericDerivative) {
  Rng rng(7);
  const auto model = static_cast<CameraModel>(GetParam());
  const Camera camera = testing::MakeTestCamera(model);
  const PoseManifold manifold;
  for (int i = 0; i < 10; ++i) {
    const std::vector<double> pose = PoseVector(rng);
    const double x = rng.Uniform(-0.5, 0.5);
    const double y = rng.Uniform(-0.4, 0.4);
    const std::vector<double> point = PointBefore(pose, x, y, rng.Uniform(0.5, 20.0));
    const ReprojectionCost cost(model, {300.0, 200.0}, 1.7);
    ExpectGradient(cost, {pose, point, camera.params}, {&manifold, nullptr, nullptr});
  }
}

/// The same residual for automatic differentiation, from the shared projection template.
struct AutodiffReprojection {
  CameraModel model;
  template <typename T>
  bool operator()(const T* pose, const T* point, const T* params, T* residuals) const {
    const T quaternion[4] = {pose[3], pose[0], pose[1], pose[2]};
    T x[3];
    ceres::UnitQuaternionRotatePoint(quaternion, point, x);
    for (int i = 0; i < 3; ++i) x[i] += pose[4 + i];
    ImageFromCamera(model, params, x, residuals);
    residuals[0] = (residuals[0] - 300.0) / 1.7;
    residuals[1] = (residuals[1] - 200.0) / 1.7;
    return true;
  }
};

template <int kNumParams>
void ExpectAgreesWithAutodiff(const Camera& camera) {
  Rng rng(8);
  const ReprojectionCost cost(camera.model, {300.0, 200.0}, 1.7);
  const ceres::AutoDiffCostFunction<AutodiffReprojection, 2, 7, 3, kNumParams> autodiff(
      new AutodiffReprojection{camera.model});
  const PoseManifold manifold;
  for (int i = 0; i < 10; ++i) {
    const std::vector<double> pose = PoseVector(rng);
    const Vectors blocks{pose,
                         PointBefore(pose, rng.Uniform(-0.5, 0.5), rng.Uniform(-0.4, 0.4), 3.0),
                         camera.params};
    Eigen::Vector2d residuals[2];
    Eigen::Matrix<double, 2, 7, Eigen::RowMajor> by_pose[2];
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point[2];
    Eigen::Matrix<double, 2, kNumParams, Eigen::RowMajor> by_params[2];
    for (int k = 0; k < 2; ++k) {
      double* jacobians[3] = {by_pose[k].data(), by_point[k].data(), by_params[k].data()};
      const ceres::CostFunction& function =
          k == 0 ? static_cast<const ceres::CostFunction&>(cost) : autodiff;
      ASSERT_TRUE(function.Evaluate(Pointers(blocks).data(), residuals[k].data(), jacobians));
    }
    // The pose's seven numbers are compared along the manifold, the only directions they move in.
    Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
    ASSERT_TRUE(manifold.PlusJacobian(pose.data(), plus.data()));
    EXPECT_LT((residuals[0] - residuals[1]).norm(), 1e-9);
    EXPECT_LT((by_pose[0] * plus - by_pose[1] * plus).norm(), 1e-8 * by_pose[1].norm());
    EXPECT_LT((by_point[0] - by_point[1]).norm(), 1e-9 * by_point[1].norm());
    EXPECT_LT((by_params[0] - by_params[1]).norm(), 1e-9 * by_params[1].norm());
  }
}

TEST_P(ReprojectionCostTest, AgreesWithAutodiff) {
  const Camera camera = testing::MakeTestCamera(static_cast<CameraModel>(GetParam()));
  switch (camera.params.size()) {
    case 3:
      return ExpectAgreesWithAutodiff<3>(camera);
    case 4:
      return ExpectAgreesWithAutodiff<4>(camera);
    case 5:
      return ExpectAgreesWithAutodiff<5>(camera);
    case 8:
      return ExpectAgreesWithAutodiff<8>(camera);
    case 12:
      return ExpectAgreesWithAutodiff<12>(camera);
    default:
      FAIL() << "a model with " << camera.params.size() << " parameters is not covered";
  }
}

TEST_P(ReprojectionCostTest, APointBehindIsAFailureAndNoZero) {
  Rng rng(9);
  const auto model = static_cast<CameraModel>(GetParam());
  const Camera camera = testing::MakeTestCamera(model);
  const std::vector<double> pose = PoseVector(rng);
  const ReprojectionCost cost(model, {300.0, 200.0}, 1.0);
  double residuals[2] = {-1.0, -1.0};
  for (const double depth : {-3.0, -1e-9, 0.0}) {
    const Eigen::Vector3d point =
        FromPoseBlock(pose.data()).Inverse() * Eigen::Vector3d(0.1, 0.2, depth);
    const Vectors blocks{pose, {point.x(), point.y(), point.z() - 1e-12}, camera.params};
    if ((FromPoseBlock(pose.data()) * Eigen::Vector3d(blocks[1].data())).z() > 0.0) continue;
    EXPECT_FALSE(cost.Evaluate(Pointers(blocks).data(), residuals, nullptr)) << "depth " << depth;
  }
}

std::string ModelName(const ::testing::TestParamInfo<int>& info) {
  return std::string(CameraModelName(static_cast<CameraModel>(info.param)));
}
INSTANTIATE_TEST_SUITE_P(AllModels, ReprojectionCostTest, ::testing::Range(0, kNumCameraModels),
                         ModelName);

TEST(PointFixedPlaneCost, IsTheDistanceInSigmas) {
  const Eigen::Vector4d plane(0.0, 0.6, 0.8, -2.0);
  const PointFixedPlaneCost cost(plane, 0.5);
  const Vectors blocks{{5.0, 1.0, 4.0}};
  double residual = 0.0;
  ASSERT_TRUE(cost.Evaluate(Pointers(blocks).data(), &residual, nullptr));
  EXPECT_NEAR(residual, (0.6 + 3.2 - 2.0) / 0.5, 1e-14);
  EXPECT_EQ(cost.parameter_block_sizes().size(), 1u);  // Touches one point and nothing else.
  ExpectGradient(cost, blocks, {nullptr});
}

TEST(PointPlaneCost, AgreesWithTheFixedPlane) {
  Rng rng(10);
  const AnchoredPlaneManifold manifold;
  const Eigen::Vector3d anchor(100.0, -50.0, 30.0);
  for (int i = 0; i < 10; ++i) {
    const std::vector<double> plane = PlaneVector(rng);
    const std::vector<double> point{anchor.x() + rng.Gaussian(), anchor.y() + rng.Gaussian(),
                                    anchor.z() + rng.Gaussian()};
    const PointPlaneCost cost(anchor, 0.3);
    ExpectGradient(cost, {point, plane}, {nullptr, &manifold});
    const Eigen::Vector3d normal(plane.data());
    const PointFixedPlaneCost fixed(
        Eigen::Vector4d(normal.x(), normal.y(), normal.z(), plane[3] - normal.dot(anchor)), 0.3);
    double residuals[2];
    const Vectors both{point, plane};
    ASSERT_TRUE(cost.Evaluate(Pointers(both).data(), &residuals[0], nullptr));
    ASSERT_TRUE(fixed.Evaluate(Pointers(both).data(), &residuals[1], nullptr));
    EXPECT_NEAR(residuals[0], residuals[1], 1e-10);
  }
}

TEST(CameraHeightCost, Gradient) {
  Rng rng(11);
  const PoseManifold pose_manifold;
  const AnchoredPlaneManifold plane_manifold;
  for (int i = 0; i < 10; ++i) {
    const CameraHeightCost cost({3.0, 1.0, -2.0}, 0.01);
    ExpectGradient(cost, {PoseVector(rng), PlaneVector(rng), {rng.Uniform(0.5, 3.0)}},
                   {&pose_manifold, &plane_manifold, nullptr});
  }
}

TEST(CameraHeightCost, HasNoUnit) {
  Rng rng(12);
  const Rigid3 pose{QuaternionFromRotationVector({0.1, 0.2, 0.3}), {1.0, -2.0, 0.5}};
  double residuals[2];
  for (int i = 0; i < 2; ++i) {
    const double scale = i == 0 ? 1.0 : 250.0;
    const PoseBlock block = ToPoseBlock({pose.rotation, scale * pose.translation});
    const Vectors blocks{{block.begin(), block.end()}, {0.0, 1.0, 0.0, 0.7 * scale}, {2.0 * scale}};
    const CameraHeightCost cost(scale * Eigen::Vector3d(1.0, 2.0, 3.0), 0.01);
    ASSERT_TRUE(cost.Evaluate(Pointers(blocks).data(), &residuals[i], nullptr));
  }
  EXPECT_NEAR(residuals[0], residuals[1], 1e-9 * std::abs(residuals[0]));
}

TEST(CameraHeightCost, RefusesAHeightThatIsNotPositive) {
  Rng rng(13);
  const Vectors blocks{PoseVector(rng), PlaneVector(rng), {0.0}};
  double residual = 0.0;
  EXPECT_FALSE(CameraHeightCost(Eigen::Vector3d::Zero(), 0.01)
                   .Evaluate(Pointers(blocks).data(), &residual, nullptr));
}

TEST(PlaneRelationCosts, Gradients) {
  Rng rng(14);
  const AnchoredPlaneManifold manifold;
  for (int i = 0; i < 10; ++i) {
    const Vectors blocks{PlaneVector(rng), PlaneVector(rng)};
    ExpectGradient(ParallelPlanesCost(0.02), blocks, {&manifold, &manifold});
    ExpectGradient(OrthogonalPlanesCost(0.02), blocks, {&manifold, &manifold});
    for (const bool opposite : {false, true}) {
      ExpectGradient(PlanesMeetCost({1.0, 2.0, 3.0}, {-2.0, 0.5, 1.0}, opposite, 0.3, 0.1), blocks,
                     {&manifold, &manifold});
    }
  }
}

TEST(PlaneRelationCosts, VanishForTheRelation) {
  const Vectors blocks{{0.0, 0.0, 1.0, 0.5}, {0.0, 0.0, -1.0, 1.0}};
  double residuals[3] = {1.0, 1.0, 1.0};
  ASSERT_TRUE(ParallelPlanesCost(0.1).Evaluate(Pointers(blocks).data(), residuals, nullptr));
  EXPECT_EQ(Eigen::Vector3d(residuals).norm(), 0.0);
  // Anchored at heights 2 and 0.5, plane a is z = 2 - 0.5 and plane b, seen from the other side,
  // z = 0.5 + 1: at the height of 4 both distances are 2.5.
  ASSERT_TRUE(PlanesMeetCost({7.0, 1.0, 4.0 - 2.0}, {-3.0, 4.0, 4.0 - 0.5}, true, 0.0, 0.1)
                  .Evaluate(Pointers(blocks).data(), residuals, nullptr));
  EXPECT_NEAR(residuals[0], 0.0, 1e-14);
  const Vectors crossed{{0.0, 0.0, 1.0, 0.5}, {0.6, 0.8, 0.0, 1.0}};
  ASSERT_TRUE(OrthogonalPlanesCost(0.1).Evaluate(Pointers(crossed).data(), residuals, nullptr));
  EXPECT_EQ(residuals[0], 0.0);
}

}  // namespace
}  // namespace s3lam
