#include "s3lam/slam/patch_refiner.h"

#include <gtest/gtest.h>

#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

/// Two cameras side by side that look at a textured wall: the second image is the first, shifted by
/// `disparity` px.
class PatchRefinerTest : public ::testing::Test {
 protected:
  static constexpr double kDisparity = 10.3;
  static constexpr double kDepth = 4.0;

  PatchRefinerTest()
      : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)),
        refiner_(options_, features_, undistorter_) {
    const cv::Mat left = testing::MakeTexture(640, 480, 12);
    cv::Mat right;
    const cv::Matx23d shift(1.0, 0.0, -kDisparity, 0.0, 1.0, 0.0);
    cv::warpAffine(left, right, shift, left.size(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
    right.convertTo(right, -1, 1.0, 8.0);  // Exposed differently.
    left_ = BuildPyramid(features_, left);
    right_ = BuildPyramid(features_, right);
    pose_right_.translation.x() = -kDisparity * kDepth / undistorter_.intrinsics().fx;
  }

  /// The wall's point at a pixel of the left image.
  [[nodiscard]] Eigen::Vector3d PointAt(const Eigen::Vector2d& pixel) const {
    return kDepth * undistorter_.intrinsics().Normalize(pixel).homogeneous();
  }

  FeatureOptions features_;
  PatchRefinerOptions options_;
  Undistorter undistorter_;
  PatchRefiner refiner_;
  ImagePyramid left_;
  ImagePyramid right_;
  Rigid3 pose_right_;
};

TEST_F(PatchRefinerTest, FindsTheMatchToATenthOfAPixel) {
  const FrameFeatures corners = ExtractFeatures(features_, undistorter_, left_.levels[0]);
  int aligned = 0;
  double sum_squared = 0.0;
  for (int i = 0; i < corners.size(); i += 5) {
    const Keypoint& keypoint = corners.keypoint(i);
    const Eigen::Vector2d pixel = keypoint.pixel.cast<double>();
    const Eigen::Vector2d truth = pixel - Eigen::Vector2d(kDisparity, 0.0);
    const PatchView reference{&left_, {}, pixel, keypoint.level};
    const PatchView target{&right_, pose_right_, truth + Eigen::Vector2d(0.6, -0.4),
                           keypoint.level};
    const auto found = refiner_.Align(reference, target, PointAt(pixel), Eigen::Vector3d::UnitZ());
    if (!found) continue;
    ++aligned;
    sum_squared += (*found - truth).squaredNorm() / (keypoint.sigma * keypoint.sigma);
  }
  EXPECT_GT(aligned, corners.size() / 5 * 7 / 10);
  EXPECT_LT(std::sqrt(sum_squared / aligned), 0.15);  // px of the level
}

TEST_F(PatchRefinerTest, RefusesAnotherPlace) {
  const Eigen::Vector2d pixel(300.5, 200.5);
  const PatchView reference{&left_, {}, pixel, 0};
  const PatchView target{&right_, pose_right_, {420.5, 310.5}, 0};
  EXPECT_FALSE(
      refiner_.Align(reference, target, PointAt(pixel), Eigen::Vector3d::UnitZ()).has_value());
}

TEST_F(PatchRefinerTest, RefusesTheImagesEdge) {
  const Eigen::Vector2d pixel(3.0, 3.0);
  const PatchView reference{&left_, {}, pixel, 0};
  const PatchView target{&right_, pose_right_, pixel, 0};
  EXPECT_FALSE(
      refiner_.Align(reference, target, PointAt(pixel), Eigen::Vector3d::UnitZ()).has_value());
}

}  // namespace
}  // namespace s3lam
