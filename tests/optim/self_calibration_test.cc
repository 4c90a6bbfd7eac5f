#include "s3lam/optim/self_calibration.h"

#include <gtest/gtest.h>

#include "s3lam/base/rng.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

/// Cameras around a cube of points, seen by `camera` with half a pixel of noise.
CalibrationProblem MakeProblem(const Camera& camera) {
  Rng rng(21);
  CalibrationProblem problem;
  for (int i = 0; i < 12; ++i) {
    const double angle = 0.15 * i;
    problem.poses.push_back(testing::LookAt(
        {3.0 * std::sin(angle), -3.0 * std::cos(angle), 0.2 * i - 1.0}, Eigen::Vector3d::Zero()));
  }
  for (int p = 0; p < 300; ++p) {
    problem.points.emplace_back(rng.Uniform(-1.5, 1.5), rng.Uniform(-1.5, 1.5),
                                rng.Uniform(-1.0, 1.0));
    for (int i = 0; i < static_cast<int>(problem.poses.size()); ++i) {
      const auto pixel = camera.ImageFromCamera(problem.poses[i] * problem.points[p]);
      if (!pixel) continue;
      const Eigen::Vector2d noise(rng.Gaussian(0.0, 0.5), rng.Gaussian(0.0, 0.5));
      problem.observations.push_back({i, p, *pixel + noise, 2.0});
    }
  }
  return problem;
}

TEST(SelfCalibration, KeepsACameraThatIsRight) {
  const Camera camera = testing::MakeTestCamera(CameraModel::kPinhole);
  const SelfCalibrationReport report = CheckCalibration({}, camera, MakeProblem(camera));
  EXPECT_FALSE(report.accepted);
  EXPECT_LT(report.cost_decrease, 0.01);
  EXPECT_EQ(report.camera.model, CameraModel::kPinhole);
  EXPECT_LT(report.pinhole_cost_decrease, 0.01);
  EXPECT_TRUE(report.better_pinhole.empty());
}

class WrongPinhole : public ::testing::TestWithParam<std::pair<CameraModel, double>> {};

TEST_P(WrongPinhole, IsToldAndKept) {
  const auto [model, distortion] = GetParam();
  Camera truth = testing::MakeTestCamera(model);
  if (distortion != 0.0) truth.params[4] += distortion;
  Camera given = testing::MakeTestCamera(model);
  const std::vector<int> pinhole = CameraModelPinholeParams(model);
  for (size_t i = 0; i + 2 < pinhole.size(); ++i) given.params[i] *= 1.03;
  given.params[pinhole.back()] += 12.0;
  const SelfCalibrationReport report = CheckCalibration({}, given, MakeProblem(truth));
  EXPECT_EQ(report.camera.FocalX(), given.FocalX());
  EXPECT_EQ(report.camera.PrincipalY(), given.PrincipalY());
  EXPECT_GT(report.pinhole_cost_decrease, kDoubtfulCostShare);
  ASSERT_EQ(report.better_pinhole.size(), 4u);
  EXPECT_NEAR(report.better_pinhole[0], truth.FocalX(), 0.01 * truth.FocalX());
  EXPECT_NEAR(report.better_pinhole[1], truth.FocalY(), 0.01 * truth.FocalY());
  EXPECT_NEAR(report.better_pinhole[2], truth.PrincipalX(), 4.0);
  EXPECT_NEAR(report.better_pinhole[3], truth.PrincipalY(), 4.0);
}

INSTANTIATE_TEST_SUITE_P(Models, WrongPinhole,
                         ::testing::Values(std::pair(CameraModel::kSimplePinhole, 0.0),
                                           std::pair(CameraModel::kPinhole, 0.0),
                                           std::pair(CameraModel::kSimpleRadial, 0.0),
                                           std::pair(CameraModel::kOpenCv, 0.0),
                                           std::pair(CameraModel::kOpenCv, 0.04),
                                           std::pair(CameraModel::kFov, 0.1)));

TEST(SelfCalibration, FindsADistortionThatWasNotGiven) {
  Camera truth = testing::MakeTestCamera(CameraModel::kPinhole);
  const Camera given = truth;
  truth.model = CameraModel::kOpenCv;
  truth.params.insert(truth.params.end(), {0.03, -0.01, 5e-4, -5e-4});
  const SelfCalibrationReport report = CheckCalibration({}, given, MakeProblem(truth));
  ASSERT_TRUE(report.accepted);
  ASSERT_EQ(report.camera.model, CameraModel::kOpenCv);
  for (size_t i = 0; i < 4; ++i) EXPECT_EQ(report.camera.params[i], given.params[i]);
  // The images of a corner of the image agree.
  const Eigen::Vector3d corner(0.5, 0.4, 1.0);
  EXPECT_LT((*report.camera.ImageFromCamera(corner) - *truth.ImageFromCamera(corner)).norm(), 0.5);
}

TEST(SelfCalibration, NeedsPointsSeenThreeTimes) {
  const Camera camera = testing::MakeTestCamera(CameraModel::kSimpleRadial);
  CalibrationProblem problem = MakeProblem(camera);
  problem.observations.resize(2);
  EXPECT_FALSE(CheckCalibration({}, camera, problem).accepted);
}

/// A camera without distortion, and one that nobody has calibrated.
Camera MakeRadial(double focal_factor) {
  Camera camera = testing::MakeTestCamera(CameraModel::kPinhole);
  camera.model = CameraModel::kRadial;
  camera.params = {focal_factor * 500.0, 0.5 * camera.width, 0.5 * camera.height, 0.0, 0.0};
  return camera;
}

TEST(RefineIntrinsics, FindsFocalLengthDistortionAndPrincipalPoint) {
  Camera truth = MakeRadial(1.0);
  truth.params[1] += 8.0;
  truth.params[3] = -0.08;
  const Camera guess = MakeRadial(1.2);
  const FocalPrior prior{guess.FocalX(), 0.5};
  const auto refinement = RefineIntrinsics({}, guess, prior, MakeProblem(truth));
  ASSERT_TRUE(refinement.has_value());
  const double error = refinement->camera.FocalX() - truth.FocalX();
  EXPECT_LT(std::abs(error), 4.0 * refinement->focal_sigma);
  EXPECT_LT(refinement->focal_sigma, 5.0);
  EXPECT_NEAR(refinement->camera.PrincipalX(), truth.PrincipalX(), 4.0);
  EXPECT_NEAR(refinement->camera.params[3], truth.params[3], 0.02);
  EXPECT_GT(refinement->mean_score, 0.5);
}

/// Without any rotation every focal length explains the images, with another depth.
TEST(RefineIntrinsics, SaysThatAStraightMotionDoesNotDetermineTheFocalLength) {
  const Camera truth = MakeRadial(1.0);
  CalibrationProblem problem = MakeProblem(truth);
  Rng rng(5);
  problem.observations.clear();
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    problem.poses[i] = Rigid3{Eigen::Quaterniond::Identity(),
                              Eigen::Vector3d(-0.1 * static_cast<double>(i), 0.0, 4.0)};
    for (size_t p = 0; p < problem.points.size(); ++p) {
      const auto pixel = truth.ImageFromCamera(problem.poses[i] * problem.points[p]);
      const Eigen::Vector2d noise(rng.Gaussian(0.0, 0.5), rng.Gaussian(0.0, 0.5));
      problem.observations.push_back(
          {static_cast<int>(i), static_cast<int>(p), pixel.value() + noise, 2.0});
    }
  }
  std::sort(problem.observations.begin(), problem.observations.end(),
            [](const auto& a, const auto& b) { return a.point < b.point; });
  const Camera guess = MakeRadial(1.2);
  const auto refinement = RefineIntrinsics({}, guess, {guess.FocalX(), 0.3}, problem);
  ASSERT_TRUE(refinement.has_value());
  EXPECT_GT(refinement->focal_sigma, 0.02 * truth.FocalX());
}

/// The later poses see everything enlarged.
CalibrationProblem MakeZoomed(double zoom) {
  const Camera camera = MakeRadial(1.0);
  CalibrationProblem problem = MakeProblem(camera);
  const Eigen::Vector2d principal(camera.PrincipalX(), camera.PrincipalY());
  for (auto& o : problem.observations) {
    if (o.pose >= 7) o.pixel = principal + zoom * (o.pixel - principal);
  }
  return problem;
}

TEST(FocalSigmaBetweenParts, IsSmallForNoiseAndTrueWherePartsContradictOneAnother) {
  const FocalPrior prior{500.0, 0.5};
  const Camera camera = MakeRadial(1.0);
  const CalibrationProblem alike = MakeZoomed(1.0);
  const auto right = RefineIntrinsics({}, camera, prior, alike);
  const CalibrationProblem zoomed = MakeZoomed(1.1);
  const auto refinement = RefineIntrinsics({}, camera, prior, zoomed);
  ASSERT_TRUE(right.has_value());
  ASSERT_TRUE(refinement.has_value());
  EXPECT_LT(FocalSigmaBetweenParts({}, camera, prior, alike), 4.0);
  const double sigma = FocalSigmaBetweenParts({}, camera, prior, zoomed);
  // No part has this focal length, and the noise does not tell.
  const double off = std::max(std::abs(refinement->camera.FocalX() - 500.0),
                              std::abs(refinement->camera.FocalX() - 550.0));
  EXPECT_GT(off, 5.0 * refinement->focal_sigma);
  EXPECT_LT(off, 4.0 * sigma);
  EXPECT_LT(sigma, 25.0);
}

TEST(FocalSigmaBetweenParts, IsZeroWhereNoPartGivesAFocalLength) {
  CalibrationProblem problem = MakeProblem(MakeRadial(1.0));
  problem.observations.clear();
  EXPECT_EQ(FocalSigmaBetweenParts({}, MakeRadial(1.0), {500.0, 0.5}, problem), 0.0);
}

TEST(RefineIntrinsics, LeavesAnExactMapAsItIs) {
  const Camera truth = MakeRadial(1.0);
  CalibrationProblem problem = MakeProblem(truth);
  for (auto& o : problem.observations) {
    o.pixel = truth.ImageFromCamera(problem.poses[o.pose] * problem.points[o.point]).value();
  }
  const auto refinement = RefineIntrinsics({}, truth, {truth.FocalX(), 0.5}, problem);
  ASSERT_TRUE(refinement.has_value());
  EXPECT_NEAR(refinement->camera.FocalX(), truth.FocalX(), 1e-4);
  EXPECT_NEAR(refinement->mean_score, 1.0, 1e-6);
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    EXPECT_LT((refinement->poses[i].translation - problem.poses[i].translation).norm(), 1e-5);
    EXPECT_LT(refinement->poses[i].rotation.angularDistance(problem.poses[i].rotation), 1e-6);
  }
}

}  // namespace
}  // namespace s3lam
