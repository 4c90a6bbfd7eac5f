#include "s3lam/refine/schur_bundle.h"

#include <gtest/gtest.h>

#include <limits>

#include "s3lam/refine/problem_builder.h"
#include "s3lam/synthetic/synthetic_map.h"

namespace s3lam {
namespace {

/// What a problem has beside reprojections.
struct Parts {
  bool planes = false;
  bool structure = false;  // Relations between the planes and heights of the cameras.
  int cameras = 0;         // So many, whose parameters are estimated, but for the last one's.
};

int MostParallel(const std::vector<AnchoredPlane>& planes, int plane) {
  int best = plane == 0 ? 1 : 0;
  const auto cosine = [&](int k) {
    return std::abs(planes[k].parameters.head<3>().dot(planes[plane].parameters.head<3>()));
  };
  for (int k = 0; k < static_cast<int>(planes.size()); ++k) {
    if (k != plane && cosine(k) > cosine(best)) best = k;
  }
  return best;
}

/// Takes images in turn for those of several cameras that are a little off what they should be.
void FreeCameras(int count, BundleProblem& problem) {
  Camera camera = problem.cameras.front();
  const double focal = camera.MeanFocal();
  camera.params = {focal, focal, 0.5 * camera.width, 0.5 * camera.height, 0.0, 0.0, 0.0, 0.0};
  camera.model = CameraModel::kOpenCv;
  for (int c = 0; c < count; ++c) {
    problem.free_camera_params.push_back({0, 1, 4, 5});
    camera.params[4] = 0.002 * c;
    problem.cameras.push_back(camera);
  }
  problem.cameras.erase(problem.cameras.begin());
  problem.free_camera_params.back().clear();
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    problem.camera_of_pose[i] = static_cast<int>(i) % count;
  }
}

BundleProblem MakeProblem(const Parts& parts, double outliers = 0.0) {
  SyntheticMapOptions options;
  options.num_images = 14;
  options.num_points = 500;
  options.max_track_window = 4;
  options.pixel_sigma = 0.7;
  options.point_sigma = 0.01;
  options.center_sigma = 0.01;
  options.rotation_sigma_deg = 0.2;
  options.outlier_fraction = outliers;
  const SyntheticMap synthetic = MakeSyntheticMap("desk", 3, options);
  BundleMap map = BuildBundleMap(synthetic.estimate);
  SelectObservations(OutlierOptions(), 1.0, true, map);
  map.problem.gauge = ChooseGauge(map.problem);
  BundleProblem& problem = map.problem;
  if (parts.cameras > 0) FreeCameras(parts.cameras, problem);
  if (!parts.planes) return problem;
  for (size_t k = 0; k < problem.observations.size(); ++k) {
    problem.observations[k].sigma = 0.8 + 0.2 * static_cast<double>(k % 3);
  }
  for (const auto& [id, surface] : synthetic.semantics.planes) {
    const int plane = static_cast<int>(problem.planes.size());
    problem.planes.push_back(
        AnchoredPlane::FromPlane(surface.plane_in_world, surface.centroid_in_world));
    for (const PointId point : surface.inliers) {
      problem.points_on_planes.push_back({map.IndexOfPoint(point), plane, 0.01});
    }
  }
  problem.planes[1].is_constant = true;
  std::sort(problem.points_on_planes.begin(), problem.points_on_planes.end(),
            [](const auto& a, const auto& b) { return a.point < b.point; });
  if (!parts.structure) return problem;
  RelationTerm relation{PlaneRelation::kOrthogonal, 0, 2, 0.1, 0.1, Eigen::Vector3d::Zero()};
  problem.relations.push_back(relation);
  relation.relation = PlaneRelation::kMeeting;
  relation.plane_b = MostParallel(problem.planes, 0);
  problem.relations.push_back(relation);
  for (int i = 0; i < static_cast<int>(problem.poses.size()); ++i) {
    problem.heights.push_back({i, 0, 0.5});
  }
  problem.pose_is_constant[5] = 1;
  problem.point_is_constant.assign(problem.points.size(), 0);
  for (size_t j = 0; j < problem.points.size(); j += 10) problem.point_is_constant[j] = 1;
  for (const int i : {2, 3}) {
    PosePriorTerm prior;
    prior.pose = i;
    prior.cam_from_world = FromPoseBlock(problem.poses[i].data());
    prior.sigma_position = prior.sigma_rotation = 0.005;
    problem.pose_priors.push_back(prior);
  }
  return problem;
}

BundleSolverOptions Precise(SolverBackend backend) {
  BundleSolverOptions options;
  options.backend = backend;
  options.function_tolerance = 1e-13;
  options.max_iterations = 200;
  return options;
}

double LargestDifference(const BundleProblem& a, const BundleProblem& b) {
  double largest = std::abs(a.height - b.height);
  for (size_t i = 0; i < a.poses.size(); ++i) {
    const Rigid3 pose_a = FromPoseBlock(a.poses[i].data());
    const Rigid3 pose_b = FromPoseBlock(b.poses[i].data());
    largest = std::max({largest, RotationAngle(pose_a.rotation, pose_b.rotation),
                        (pose_a.translation - pose_b.translation).norm()});
  }
  for (size_t k = 0; k < a.planes.size(); ++k) {
    largest = std::max(largest, (a.planes[k].parameters - b.planes[k].parameters).norm());
  }
  for (size_t c = 0; c < a.cameras.size(); ++c) {
    for (size_t i = 0; i < a.cameras[c].params.size(); ++i) {
      const double change = a.cameras[c].params[i] - b.cameras[c].params[i];
      largest = std::max(largest, std::abs(change) / a.cameras[c].MeanFocal());
    }
  }
  return largest;
}

bool SameBytes(const BundleProblem& a, const BundleProblem& b) {
  return a.poses == b.poses && a.points == b.points && a.height == b.height &&
         std::equal(a.planes.begin(), a.planes.end(), b.planes.begin(),
                    [](const auto& x, const auto& y) { return x.parameters == y.parameters; }) &&
         std::equal(a.cameras.begin(), a.cameras.end(), b.cameras.begin(),
                    [](const auto& x, const auto& y) { return x.params == y.params; });
}

class SchurBundleTest : public ::testing::TestWithParam<Parts> {};

TEST_P(SchurBundleTest, ReachesTheMinimumThatCeresFinds) {
  for (const double outliers : {0.0, 0.05}) {
    const BundleProblem start = MakeProblem(GetParam(), outliers);
    BundleProblem by_ceres = start;
    BundleProblem by_schur = start;
    const BundleSolverReport ceres = SolveBundle(Precise(SolverBackend::kCeres), by_ceres);
    const BundleSolverReport schur = SolveBundle(Precise(SolverBackend::kSchur), by_schur);
    EXPECT_NEAR(schur.initial_cost, ceres.initial_cost, 1e-10 * ceres.initial_cost);
    EXPECT_LT(schur.final_cost, 0.5 * schur.initial_cost);
    EXPECT_LT(schur.final_cost, ceres.final_cost * (1.0 + 1e-8));
    EXPECT_TRUE(schur.converged) << schur.message;
    // With the cost flat at its minimum, places agree to the root of its precision.
    EXPECT_LT(LargestDifference(by_schur, by_ceres), 1e-4);
    EXPECT_NEAR(BundleCost(BundleSolverOptions(), by_schur), schur.final_cost,
                1e-10 * schur.final_cost);
  }
}

TEST_P(SchurBundleTest, GivesTheSameBytesForAnyNumberOfThreads) {
  const BundleProblem start = MakeProblem(GetParam());
  for (const LinearSolver solver :
       {LinearSolver::kDenseSchur, LinearSolver::kSparseSchur, LinearSolver::kIterativeSchur}) {
    std::vector<BundleProblem> results;
    for (const int threads : {1, 2, 3, 7}) {
      BundleSolverOptions options;
      options.linear_solver = solver;
      options.num_threads = threads;
      results.push_back(start);
      SolveBundleBySchur(options, results.back());
      EXPECT_TRUE(SameBytes(results.front(), results.back())) << threads << " threads";
    }
  }
}

TEST_P(SchurBundleTest, AllLinearSolversReachTheSameMinimum) {
  const BundleProblem start = MakeProblem(GetParam());
  BundleProblem reference = start;
  const double cost = SolveBundle(Precise(SolverBackend::kCeres), reference).final_cost;
  for (const LinearSolver solver :
       {LinearSolver::kDenseSchur, LinearSolver::kSparseSchur, LinearSolver::kIterativeSchur}) {
    BundleSolverOptions options = Precise(SolverBackend::kSchur);
    options.linear_solver = solver;
    BundleProblem problem = start;
    EXPECT_NEAR(SolveBundle(options, problem).final_cost, cost, 1e-7 * cost);
  }
}

TEST_P(SchurBundleTest, WhatIsConstantStaysAndTheScaleIsHeld) {
  const BundleProblem start = MakeProblem(GetParam());
  BundleProblem problem = start;
  SolveBundle(BundleSolverOptions(), problem);
  const auto distance = [](const BundleProblem& p) {
    return (FromPoseBlock(p.poses[p.gauge.fixed_pose].data()).CenterInB() -
            FromPoseBlock(p.poses[p.gauge.scale_pose].data()).CenterInB())
        .norm();
  };
  EXPECT_NEAR(distance(problem), distance(start), 1e-12 * distance(start));
  size_t num_moved = 0;
  for (size_t i = 0; i < start.poses.size(); ++i) {
    const bool constant =
        start.pose_is_constant[i] != 0 || static_cast<int>(i) == start.gauge.fixed_pose;
    EXPECT_TRUE(!constant || problem.poses[i] == start.poses[i]);
    num_moved += problem.poses[i] != start.poses[i];
  }
  EXPECT_GE(num_moved, start.poses.size() - 2);
  for (size_t j = 0; j < start.point_is_constant.size(); ++j) {
    EXPECT_TRUE(start.point_is_constant[j] == 0 || problem.points[j] == start.points[j]);
  }
  for (size_t k = 0; k < start.planes.size(); ++k) {
    EXPECT_EQ(problem.planes[k].parameters == start.planes[k].parameters,
              start.planes[k].is_constant);
  }
}

INSTANTIATE_TEST_SUITE_P(Problems, SchurBundleTest,
                         ::testing::Values(Parts{false, false}, Parts{true, false},
                                           Parts{true, true}, Parts{false, false, 2},
                                           Parts{true, true, 2}, Parts{true, true, 4}));

TEST(SchurBundle, APointSeenTwiceByAnImageCountsTwice) {
  BundleProblem start = MakeProblem({});
  const BundleObservation twice = start.observations.front();
  start.observations.insert(start.observations.begin(), twice);
  BundleProblem by_ceres = start;
  BundleProblem by_schur = start;
  const double cost = SolveBundle(Precise(SolverBackend::kCeres), by_ceres).final_cost;
  EXPECT_NEAR(SolveBundle(Precise(SolverBackend::kSchur), by_schur).final_cost, cost, 1e-8 * cost);
}

TEST(SchurBundle, AStartBehindACameraIsRefusedAndLeftAlone) {
  BundleProblem start = MakeProblem({});
  const Rigid3 pose = FromPoseBlock(start.poses[start.observations.front().pose].data());
  start.points[start.observations.front().point] = pose.Inverse() * Eigen::Vector3d(0, 0, -1.0);
  BundleProblem problem = start;
  EXPECT_THROW(SolveBundleBySchur(BundleSolverOptions(), problem), std::runtime_error);
  EXPECT_TRUE(SameBytes(problem, start));
}

TEST(SchurBundle, NotANumberIsRefused) {
  BundleProblem problem = MakeProblem({});
  problem.points[problem.observations.front().point].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(SolveBundleBySchur(BundleSolverOptions(), problem), std::runtime_error);
}

TEST(SchurBundle, OnlyFreeCameraParametersMove) {
  const BundleProblem start = MakeProblem({false, false, 3});
  BundleProblem problem = start;
  SolveBundleBySchur(BundleSolverOptions(), problem);
  for (size_t c = 0; c < start.cameras.size(); ++c) {
    const std::vector<int>& free = start.free_camera_params[c];
    for (int i = 0; i < static_cast<int>(start.cameras[c].params.size()); ++i) {
      const bool moved = problem.cameras[c].params[i] != start.cameras[c].params[i];
      EXPECT_EQ(moved, std::find(free.begin(), free.end(), i) != free.end()) << c << " " << i;
    }
  }
}

TEST(SchurBundle, AllPosesConstantMeansTriangulation) {
  BundleProblem start = MakeProblem({});
  std::fill(start.pose_is_constant.begin(), start.pose_is_constant.end(), uint8_t{1});
  BundleProblem by_ceres = start;
  BundleProblem by_schur = start;
  const double cost = SolveBundle(Precise(SolverBackend::kCeres), by_ceres).final_cost;
  EXPECT_NEAR(SolveBundle(Precise(SolverBackend::kSchur), by_schur).final_cost, cost, 1e-8 * cost);
}

}  // namespace
}  // namespace s3lam
