#include "s3lam/refine/covariance.h"

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include <deque>

#include "refine/refine_fixture.h"
#include "s3lam/base/rng.h"
#include "s3lam/refine/cost_functions.h"
#include "s3lam/refine/manifolds.h"

namespace s3lam::refine {
namespace {

/// A small map with two planes, all residuals within the robust thresholds' reach.
struct SmallProblem {
  BundleMap map;
  BundleSolverOptions solver;
};

SmallProblem MakeSmallProblem(const Reconstruction& model) {
  SmallProblem small;
  small.map = BuildBundleMap(model);
  SelectObservations({}, 1.0, true, small.map);
  BundleProblem& problem = small.map.problem;
  problem.gauge = ChooseGauge(problem);
  // Two planes through the first points: the covariance does not ask whether they are true.
  for (int k = 0; k < 2; ++k) {
    const Plane plane{Eigen::Vector3d(0.1 * k, 0.2, 1.0).normalized(), 0.0};
    problem.planes.push_back(AnchoredPlane::FromPlane(plane, problem.points[10 * k]));
    for (int j = 10 * k; j < 10 * k + 8; ++j) problem.points_on_planes.push_back({j, k, 0.05});
  }
  return small;
}

Reconstruction SmallModel() {
  return MakeDeskMap({"num_images=6", "num_points=80", "max_track_window=0"}).truth;
}

/// The same problem given to Ceres directly, robust losses included.
class CeresReference {
 public:
  explicit CeresReference(BundleProblem& problem) : problem_(problem) {
    ceres::Problem::Options options;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres_ = std::make_unique<ceres::Problem>(options);
    for (const BundleObservation& o : problem.observations) {
      Camera& camera = problem.cameras[problem.camera_of_pose[o.pose]];
      ceres_->AddResidualBlock(new ReprojectionCost(camera.model, o.pixel, 1.0),
                               new ceres::HuberLoss(2.4477), problem.poses[o.pose].data(),
                               problem.points[o.point].data(), camera.params.data());
      ceres_->SetParameterBlockConstant(camera.params.data());
      ceres_->SetManifold(problem.poses[o.pose].data(), &pose_manifold_);
    }
    for (const PointOnPlane& term : problem.points_on_planes) {
      AnchoredPlane& plane = problem.planes[term.plane];
      ceres_->AddResidualBlock(new PointPlaneCost(plane.anchor_in_world, term.sigma),
                               new ceres::HuberLoss(1.96), problem.points[term.point].data(),
                               plane.parameters.data());
      ceres_->SetManifold(plane.parameters.data(), &plane_manifold_);
    }
    double* fixed = problem.poses[problem.gauge.fixed_pose].data();
    ceres_->SetParameterBlockConstant(fixed);
    scale_manifold_ = std::make_unique<HeldDistancePoseManifold>(FromPoseBlock(fixed).CenterInB());
    ceres_->SetManifold(problem.poses[problem.gauge.scale_pose].data(), scale_manifold_.get());
  }

  std::vector<double> TangentCovariance(double* block) {
    ceres::Covariance::Options options;
    options.algorithm_type = ceres::DENSE_SVD;
    ceres::Covariance covariance(options);
    EXPECT_TRUE(covariance.Compute(std::vector<const double*>{block}, ceres_.get()));
    const int size = ceres_->ParameterBlockTangentSize(block);
    std::vector<double> values(static_cast<size_t>(size * size));
    EXPECT_TRUE(covariance.GetCovarianceBlockInTangentSpace(block, block, values.data()));
    return values;
  }

 private:
  BundleProblem& problem_;
  PoseManifold pose_manifold_;
  AnchoredPlaneManifold plane_manifold_;
  std::unique_ptr<HeldDistancePoseManifold> scale_manifold_;
  std::unique_ptr<ceres::Problem> ceres_;
};

TEST(Covariance, IsThatOfCeres) {
  SmallProblem small = MakeSmallProblem(SmallModel());
  BundleProblem& problem = small.map.problem;
  CovarianceOptions sparse;
  sparse.max_dense_rows = 1;
  const auto dense = ComputeCovariance({}, small.solver, problem);
  const auto by_blocks = ComputeCovariance(sparse, small.solver, problem);
  ASSERT_TRUE(dense.has_value());
  ASSERT_TRUE(by_blocks.has_value());
  CeresReference reference(problem);
  const auto fixed = static_cast<size_t>(problem.gauge.fixed_pose);
  const auto scale = static_cast<size_t>(problem.gauge.scale_pose);
  EXPECT_FALSE(dense->poses[fixed].has_value());
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    if (i == fixed) continue;
    ASSERT_TRUE(dense->poses[i].has_value());
    EXPECT_LT((*dense->poses[i] - *by_blocks->poses[i]).norm(), 1e-6 * dense->poses[i]->norm());
    if (i == scale) continue;
    const auto values = reference.TangentCovariance(problem.poses[i].data());
    const Eigen::Map<const Matrix6d> expected(values.data());
    EXPECT_LT((*dense->poses[i] - expected).norm(), 1e-6 * expected.norm()) << i;
  }
  for (size_t k = 0; k < problem.planes.size(); ++k) {
    const auto values = reference.TangentCovariance(problem.planes[k].parameters.data());
    const Eigen::Map<const Eigen::Matrix3d> expected(values.data());
    EXPECT_LT((*dense->planes[k] - expected).norm(), 1e-6 * expected.norm()) << k;
    EXPECT_LT((*by_blocks->planes[k] - expected).norm(), 1e-6 * expected.norm()) << k;
  }
}

TEST(Covariance, TheHeldDistanceIsCertain) {
  const SmallProblem small = MakeSmallProblem(SmallModel());
  const BundleProblem& problem = small.map.problem;
  const auto covariance = ComputeCovariance({}, small.solver, problem);
  ASSERT_TRUE(covariance.has_value());
  const Rigid3 fixed = FromPoseBlock(problem.poses[problem.gauge.fixed_pose].data());
  const Rigid3 held = FromPoseBlock(problem.poses[problem.gauge.scale_pose].data());
  const Eigen::Matrix3d of_center =
      CenterCovariance(*covariance->poses[problem.gauge.scale_pose], held, {})
          .bottomRightCorner<3, 3>();
  const Eigen::Vector3d direction = (held.CenterInB() - fixed.CenterInB()).normalized();
  EXPECT_LT(direction.dot(of_center * direction), 1e-12 * of_center.trace());
  EXPECT_GT(of_center.trace(), 0.0);
}

TEST(Covariance, AFreedomLeftOpenIsSeen) {
  SmallProblem small = MakeSmallProblem(SmallModel());
  small.map.problem.points_on_planes.clear();
  // A plane that one point holds.
  small.map.problem.points_on_planes.push_back({0, 0, 0.05});
  EXPECT_FALSE(ComputeCovariance({}, small.solver, small.map.problem).has_value());
}

TEST(Covariance, PlanesWithoutPointsDoNoHarm) {
  SmallProblem small = MakeSmallProblem(SmallModel());
  BundleProblem& problem = small.map.problem;
  const auto before = ComputeCovariance({}, small.solver, problem);
  problem.planes.resize(4, problem.planes.front());
  problem.relations.push_back({PlaneRelation::kParallel, 2, 3});
  problem.relations.push_back({PlaneRelation::kParallel, 0, 3});
  const auto after = ComputeCovariance({}, small.solver, problem);
  ASSERT_TRUE(before.has_value());
  ASSERT_TRUE(after.has_value());
  EXPECT_FALSE(after->planes[2].has_value());
  EXPECT_FALSE(after->planes[3].has_value());
  EXPECT_LT((*after->planes[0] - *before->planes[0]).norm(), 1e-12 * before->planes[0]->norm());
}

TEST(Covariance, CamerasThatWereRefinedMakePosesLessCertain) {
  const SyntheticMap map = MakeDeskMap();
  Output kept;
  Output refined;
  refine::Run(MakeOptions({"covariance.enabled=true", "planes.mode=off"}), MakeInput(map), kept);
  const Report report = refine::Run(
      MakeOptions({"covariance.enabled=true", "planes.mode=off", "intrinsics.focal_length=true"}),
      MakeInput(map), refined);
  ASSERT_TRUE(report.cameras.front().refined);
  ASSERT_TRUE(refined.covariance.computed);
  double largest = 0.0;
  for (const auto& [id, matrix] : kept.covariance.poses) {
    largest = std::max(largest, refined.covariance.poses.at(id).trace() / matrix.trace());
  }
  EXPECT_GT(largest, 1.5);
}

/// The same problem with other noise many times: the poses scatter as the covariance says.
TEST(Covariance, IsTheScatterOverManyDraws) {
  Reconstruction truth = SmallModel();
  for (auto& [id, image] : truth.images) {
    for (Point2D& seen : image.points2D) {
      if (!seen.point_id.valid()) continue;
      const auto pixel = truth.CameraOf(image).ImageFromCamera(image.cam_from_world *
                                                               truth.points.at(seen.point_id).xyz);
      ASSERT_TRUE(pixel.has_value());
      seen.xy = *pixel;
    }
  }
  BundleMap map = BuildBundleMap(truth);
  SelectObservations({}, 1.0, true, map);
  map.problem.gauge = ChooseGauge(map.problem);
  BundleSolverOptions solver;
  solver.huber_reprojection = 1e3;
  const auto covariance = ComputeCovariance({}, solver, map.problem);
  ASSERT_TRUE(covariance.has_value());
  const int pose = map.problem.gauge.scale_pose == 5 ? 4 : 5;
  const Rigid3 true_pose = FromPoseBlock(map.problem.poses[pose].data());
  const Eigen::Matrix3d predicted =
      CenterCovariance(*covariance->poses[pose], true_pose, {}).bottomRightCorner<3, 3>();
  Rng rng(11);
  constexpr int kDraws = 150;
  double squared = 0.0;
  double mahalanobis = 0.0;
  for (int draw = 0; draw < kDraws; ++draw) {
    BundleProblem noisy = map.problem;
    for (BundleObservation& o : noisy.observations) {
      o.pixel += Eigen::Vector2d(rng.Gaussian(), rng.Gaussian());
    }
    SolveBundle(solver, noisy);
    const Eigen::Vector3d error =
        FromPoseBlock(noisy.poses[pose].data()).CenterInB() - true_pose.CenterInB();
    squared += error.squaredNorm() / kDraws;
    mahalanobis += error.dot(predicted.inverse() * error) / kDraws;
  }
  // Three degrees of freedom, 150 draws: the means scatter by about a tenth.
  EXPECT_NEAR(mahalanobis, 3.0, 0.8);
  EXPECT_NEAR(squared / predicted.trace(), 1.0, 0.35);
}

TEST(Covariance, PlanesAndPosesAreGivenInTheOutputsWorld) {
  const SyntheticMap map = MakeDeskMap();
  Output output;
  Output without;
  const auto on = MakeOptions({"covariance.enabled=true"});
  refine::Run(on, MakeInput(map), output);
  refine::Run(MakeOptions({}), MakeInput(map), without);
  EXPECT_FALSE(without.covariance.computed);
  ASSERT_TRUE(output.covariance.computed);
  EXPECT_EQ(output.covariance.poses.size(), map.estimate.images.size() - 1);
  EXPECT_GT(output.covariance.planes.size(), 2u);
  // Ten times the map, ten times the sigmas of places and none of angles.
  Input large = MakeInput(map);
  const Similarity3 scaling{10.0, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero()};
  TransformReconstruction(scaling, large.model);
  for (auto& [id, surface] : large.semantics.planes) {
    surface.plane_in_world = TransformPlane(scaling, surface.plane_in_world);
    surface.centroid_in_world *= 10.0;
  }
  Output scaled;
  refine::Run(on, large, scaled);
  for (const auto& [id, matrix] : output.covariance.poses) {
    const Matrix6d& other = scaled.covariance.poses.at(id);
    EXPECT_NEAR((other.topLeftCorner<3, 3>().trace() / matrix.topLeftCorner<3, 3>().trace()), 1.0,
                0.01);
    EXPECT_NEAR(
        (other.bottomRightCorner<3, 3>().trace() / matrix.bottomRightCorner<3, 3>().trace()), 100.0,
        1.0);
  }
  for (const auto& [id, matrix] : output.covariance.planes) {
    EXPECT_NEAR(scaled.covariance.planes.at(id)(2, 2) / matrix(2, 2), 100.0, 1.0);
  }
}

}  // namespace
}  // namespace s3lam::refine
