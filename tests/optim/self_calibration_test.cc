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
  const SelfCalibrationReport report = RefineDistortion({}, camera, MakeProblem(camera));
  EXPECT_FALSE(report.accepted);
  EXPECT_LT(report.cost_decrease, 0.01);
  EXPECT_EQ(report.camera.model, CameraModel::kPinhole);
}

TEST(SelfCalibration, FindsADistortionThatWasNotGiven) {
  Camera truth = testing::MakeTestCamera(CameraModel::kPinhole);
  const Camera given = truth;
  truth.model = CameraModel::kOpenCv;
  truth.params.insert(truth.params.end(), {0.03, -0.01, 5e-4, -5e-4});
  const SelfCalibrationReport report = RefineDistortion({}, given, MakeProblem(truth));
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
  EXPECT_FALSE(RefineDistortion({}, camera, problem).accepted);
}

}  // namespace
}  // namespace s3lam
