#include "s3lam/refine/plane_model.h"

#include <gtest/gtest.h>

#include <numeric>

namespace s3lam {
namespace {

/// The plane z = 0 with points above it, each as uncertain as the plane is rough: a sigma of one.
class AssignPointsTest : public ::testing::Test {
 protected:
  void AddPoint(double height) {
    const auto i = static_cast<double>(problem_.points.size());
    problem_.points.emplace_back(i, 0.0, height);
  }

  /// All points are candidates, and members so far.
  MembershipCounts Assign(double huber_plane) {
    const size_t count = problem_.points.size();
    PlaneState plane;
    plane.kappa = 1.0;
    plane.candidates.resize(count);
    std::iota(plane.candidates.begin(), plane.candidates.end(), 0);
    plane.members = plane.candidates;
    planes_.planes = {plane};
    planes_.keypoint_size.assign(count, 1.0);
    planes_.covariances.assign(count, Eigen::Matrix3d::Identity());
    problem_.planes = {
        AnchoredPlane::FromPlane({Eigen::Vector3d::UnitZ(), 0.0}, Eigen::Vector3d::Zero())};
    BundleSolverOptions solver;
    solver.huber_plane = huber_plane;
    MembershipOptions options;
    options.min_points = 1;
    return AssignPoints(options, PlaneSigmaOptions(), solver, planes_, problem_);
  }

  BundleProblem problem_;
  PlaneModel planes_;
};

// Half way between its triangulation, at 3.8, and the plane; or hardly moved, if the loss is flat.
TEST_F(AssignPointsTest, HowFarAPointWasPulledIsJudgedByTheLossOfTheSolve) {
  AddPoint(0.1);
  AddPoint(1.9);
  EXPECT_EQ(Assign(1.96).members, 1U);
  EXPECT_EQ(Assign(0.1).members, 2U);
}

}  // namespace
}  // namespace s3lam
