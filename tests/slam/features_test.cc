#include "s3lam/slam/features.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>

#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

Camera TestCamera() { return testing::MakeTestCamera(CameraModel::kOpenCv); }

/// A fisheye lens whose image is a circle of `radius_px`, 95 degrees off the axis at its edge.
Camera MakeFisheye(double radius_px) {
  const double focal = radius_px / (95.0 * std::numbers::pi / 180.0);
  return {CameraId(1), CameraModel::kOpenCvFisheye, 512, 512, {focal, focal, 256, 256, 0, 0, 0, 0}};
}

TEST(Undistorter, BoundsOfFisheyesHoldNoMoreThan80Degrees) {
  for (const double radius : {250.0, 330.0, 400.0}) {
    const Camera camera = MakeFisheye(radius);
    const Undistorter undistorter(camera);
    const double reach = std::tan(80.1 * std::numbers::pi / 180.0) * camera.FocalX();
    const double seen = std::tan(50.0 * std::numbers::pi / 180.0);
    EXPECT_GT(undistorter.lower().x(), 256.0 - reach) << radius;
    EXPECT_LT(undistorter.upper().y(), 256.0 + reach) << radius;
    EXPECT_LT(undistorter.lower().y(), 256.0 - seen * camera.FocalX()) << radius;
    EXPECT_GT(undistorter.upper().x(), 256.0 + seen * camera.FocalX()) << radius;
  }
}

Keypoint KeypointAt(const Undistorter& undistorter, float x, float y) {
  Keypoint keypoint;
  keypoint.pixel = {x, y};
  keypoint.undistorted = undistorter.Undistort({x, y})->cast<float>();
  return keypoint;
}

TEST(Undistorter, CellsOfWideLensesAreThoseOfTheImage) {
  const Undistorter undistorter(MakeFisheye(400.0));
  EXPECT_EQ(undistorter.CellOf(KeypointAt(undistorter, 100.0F, 120.0F), 4, 4), 0u);
  EXPECT_EQ(undistorter.CellOf(KeypointAt(undistorter, 200.0F, 300.0F), 4, 4), 9u);
  EXPECT_EQ(undistorter.CellOf(KeypointAt(undistorter, 400.0F, 390.0F), 4, 4), 15u);
}

TEST(Undistorter, OtherCellsAreThoseOfTheUndistortedImage) {
  const Undistorter undistorter(TestCamera());
  Keypoint keypoint;
  keypoint.undistorted = (0.6 * undistorter.lower() + 0.4 * undistorter.upper()).cast<float>();
  EXPECT_EQ(undistorter.CellOf(keypoint, 4, 4), 5u);
}

TEST(Undistorter, AgreesWithTheCameraModel) {
  const Camera camera = TestCamera();
  const Undistorter undistorter(camera);
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(0.5, 0.5), Eigen::Vector2d(639.0, 3.0), Eigen::Vector2d(321.7, 240.2),
        Eigen::Vector2d(17.3, 460.9)}) {
    const auto undistorted = undistorter.Undistort(pixel);
    ASSERT_TRUE(undistorted.has_value());
    const Eigen::Vector3d ray = undistorter.intrinsics().Normalize(*undistorted).homogeneous();
    EXPECT_LT((*camera.ImageFromCamera(ray) - pixel).norm(), 1e-6);
  }
}

TEST(ExtractFeatures, SpreadsKeypointsOverImageAndScale) {
  const Undistorter undistorter(TestCamera());
  const FeatureOptions options;
  const FrameFeatures features =
      ExtractFeatures(options, undistorter, testing::MakeTexture(640, 480, 1));
  EXPECT_GT(features.size(), 900);
  EXPECT_LT(features.size(), 1200);
  std::set<int> levels;
  std::set<int> cells;
  for (int i = 0; i < features.size(); ++i) {
    const Keypoint& keypoint = features.keypoint(i);
    levels.insert(keypoint.level);
    cells.insert(static_cast<int>(keypoint.pixel.y() / 80) * 8 +
                 static_cast<int>(keypoint.pixel.x() / 80));
    EXPECT_NEAR(keypoint.sigma, std::pow(1.2, keypoint.level), 0.02);
  }
  EXPECT_EQ(levels.size(), 8U);
  EXPECT_EQ(cells.size(), 48U);  // All of them.
}

TEST(ExtractFeatures, FollowsAShiftOfTheImage) {
  const Undistorter undistorter(testing::MakeTestCamera(CameraModel::kPinhole));
  const cv::Mat large = testing::MakeTexture(660, 500, 2);
  const FrameFeatures a = ExtractFeatures({}, undistorter, large(cv::Rect(0, 0, 640, 480)).clone());
  const FrameFeatures b = ExtractFeatures({}, undistorter, large(cv::Rect(6, 4, 640, 480)).clone());
  int found = 0;
  for (int i = 0; i < a.size(); ++i) {
    if (a.keypoint(i).level != 0) continue;
    const Eigen::Vector2d expected =
        a.keypoint(i).undistorted.cast<double>() - Eigen::Vector2d(6, 4);
    bool same = false;
    b.VisitNear(expected, 0.6, 0, 0, [&](int j) {
      same = same || HammingDistance(a.descriptor(i), b.descriptor(j)) < 20;
    });
    found += same;
  }
  EXPECT_GT(found, 100);
}

TEST(ExtractFeatures, KeepsOffTheMask) {
  const Undistorter undistorter(TestCamera());
  cv::Mat mask(480, 640, CV_8UC1, cv::Scalar(255));
  mask(cv::Rect(0, 0, 320, 480)) = 0;
  const FrameFeatures features =
      ExtractFeatures({}, undistorter, testing::MakeTexture(640, 480, 3), mask);
  ASSERT_GT(features.size(), 100);
  for (int i = 0; i < features.size(); ++i) EXPECT_GE(features.keypoint(i).pixel.x(), 319.0F);
}

TEST(ExtractFeatures, HasNothingToSayOfABlackOrTinyImage) {
  const Undistorter undistorter(TestCamera());
  EXPECT_EQ(ExtractFeatures({}, undistorter, cv::Mat(480, 640, CV_8UC1, cv::Scalar(0))).size(), 0);
  Camera tiny = testing::MakeTestCamera(CameraModel::kPinhole);
  tiny.width = 1;
  tiny.height = 1;
  EXPECT_EQ(ExtractFeatures({}, Undistorter(tiny), cv::Mat(1, 1, CV_8UC1, cv::Scalar(9))).size(),
            0);
}

TEST(FrameFeatures, VisitsExactlyWhatIsNear) {
  Rng rng(4);
  const Undistorter undistorter(TestCamera());
  const FrameFeatures features =
      testing::SeeCloud(testing::MakeCloud(500, false, 5), {}, undistorter, 0.0, rng);
  const Eigen::Vector2d center(200.0, 150.0);
  std::set<int> visited;
  features.VisitNear(center, 60.0, 0, 0, [&](int i) { visited.insert(i); });
  std::set<int> expected;
  for (int i = 0; i < features.size(); ++i) {
    const Eigen::Vector2d d = features.keypoint(i).undistorted.cast<double>() - center;
    if (d.cwiseAbs().maxCoeff() <= 60.0) expected.insert(i);
  }
  EXPECT_GT(expected.size(), 5U);
  EXPECT_EQ(visited, expected);
}

}  // namespace
}  // namespace s3lam
