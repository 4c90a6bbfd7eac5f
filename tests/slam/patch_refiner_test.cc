#include "s3lam/slam/patch_refiner.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

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

  struct Alignment {
    double share = 0.0;  // Of the corners.
    double rms = 0.0;    // Of their distances from the truth [px of the level].
  };
  /// Corners of the left image in another one, from places that are off by 0.7 px.
  [[nodiscard]] Alignment AlignAll(const ImagePyramid& right) const {
    const FrameFeatures corners = ExtractFeatures(features_, undistorter_, left_.levels[0]);
    int tried = 0;
    int aligned = 0;
    double sum_squared = 0.0;
    for (int i = 0; i < corners.size(); i += 5) {
      const Keypoint& keypoint = corners.keypoint(i);
      const Eigen::Vector2d pixel = keypoint.pixel.cast<double>();
      const Eigen::Vector2d truth = pixel - Eigen::Vector2d(kDisparity, 0.0);
      const PatchView reference{&left_, {}, pixel, keypoint.level};
      const PatchView target{&right, pose_right_, truth + Eigen::Vector2d(0.6, -0.4),
                             keypoint.level};
      ++tried;
      const auto found =
          refiner_.Align(reference, target, PointAt(pixel), Eigen::Vector3d::UnitZ());
      if (!found) continue;
      ++aligned;
      sum_squared += (*found - truth).squaredNorm() / (keypoint.sigma * keypoint.sigma);
    }
    return {static_cast<double>(aligned) / tried, std::sqrt(sum_squared / aligned)};
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
  const Alignment alignment = AlignAll(right_);
  EXPECT_GT(alignment.share, 0.7);
  EXPECT_LT(alignment.rms, 0.15);
}

TEST_F(PatchRefinerTest, AnotherExposureNeitherMovesNorLosesTheMatch) {
  const Alignment same = AlignAll(right_);
  for (const double gain : {0.4, 0.7}) {
    cv::Mat exposed;
    right_.levels[0].convertTo(exposed, -1, gain, 128.0 * (1.0 - gain));
    const Alignment alignment = AlignAll(BuildPyramid(features_, exposed));
    EXPECT_GT(alignment.share, 0.9 * same.share) << gain;
    EXPECT_LT(alignment.rms, 1.25 * same.rms) << gain;
  }
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

/// A wall that recedes to the right, seen by cameras side by side and by one nearer to it.
class ObliqueWallTest : public ::testing::Test {
 protected:
  ObliqueWallTest()
      : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)),
        refiner_(options_, features_, undistorter_) {
    const cv::Mat reference = testing::MakeTexture(640, 480, 12);
    reference_ = BuildPyramid(features_, reference);
    const PinholeIntrinsics& in = undistorter_.intrinsics();
    Eigen::Matrix3d k;
    k << in.fx, 0.0, in.cx, 0.0, in.fy, in.cy, 0.0, 0.0, 1.0;
    Eigen::Matrix3d from_opencv =
        Eigen::Matrix3d::Identity();  // Whose pixels are at whole numbers.
    from_opencv.topRightCorner<2, 1>().setConstant(0.5);
    for (size_t i = 0; i < targets_.size(); ++i) {
      poses_[i].translation = translations_[i];
      homographies_[i] =
          k *
          (Eigen::Matrix3d::Identity() + poses_[i].translation * normal_.transpose() / kDistance) *
          k.inverse();
      const Eigen::Matrix3d in_opencv = from_opencv.inverse() * homographies_[i] * from_opencv;
      cv::Matx33d h;
      for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) h(r, c) = in_opencv(r, c);
      }
      cv::Mat image;
      cv::warpPerspective(reference, image, h, reference.size(), cv::INTER_CUBIC,
                          cv::BORDER_REPLICATE);
      targets_[i] = BuildPyramid(features_, image);
    }
  }

  /// A corner of the reference's image and where the others show it.
  struct Corner {
    PatchView reference;
    Eigen::Vector3d point;
    std::array<PatchView, 3> views;  // Off by half a pixel.
    std::array<Eigen::Vector2d, 3> truths;
  };
  [[nodiscard]] std::vector<Corner> Corners() const {
    std::vector<Corner> corners;
    const FrameFeatures features = ExtractFeatures(features_, undistorter_, reference_.levels[0]);
    for (int i = 0; i < features.size(); i += 5) {
      const Keypoint& keypoint = features.keypoint(i);
      const Eigen::Vector2d pixel = keypoint.pixel.cast<double>();
      const Eigen::Vector3d ray = undistorter_.intrinsics().Normalize(pixel).homogeneous();
      if (ray.dot(normal_) < 0.2) continue;
      Corner& corner = corners.emplace_back();
      corner.reference = {&reference_, {}, pixel, keypoint.level};
      corner.point = kDistance / ray.dot(normal_) * ray;
      for (size_t k = 0; k < corner.views.size(); ++k) {
        corner.truths[k] = (homographies_[k] * pixel.homogeneous()).hnormalized();
        const Eigen::Vector2d start = corner.truths[k] + Eigen::Vector2d(0.3, -0.3);
        corner.views[k] = {&targets_[k], poses_[k], start, keypoint.level};
      }
    }
    return corners;
  }

  static constexpr double kDistance = 2.0;  // Of the wall's plane from the reference.

  const Eigen::Vector3d normal_ = Eigen::Vector3d(-0.8, 0.0, 0.6);
  const std::array<Eigen::Vector3d, 3> translations_{Eigen::Vector3d(-0.6, 0.0, 0.0),
                                                     Eigen::Vector3d(0.6, 0.0, 0.0),
                                                     Eigen::Vector3d(0.0, 0.0, -0.6)};
  FeatureOptions features_;
  PatchRefinerOptions options_;
  Undistorter undistorter_;
  PatchRefiner refiner_;
  ImagePyramid reference_;
  std::array<Rigid3, 3> poses_;
  std::array<Eigen::Matrix3d, 3> homographies_;
  std::array<ImagePyramid, 3> targets_;
};

TEST_F(ObliqueWallTest, NormalIsFoundAndPlacesAreTruerForIt) {
  const Eigen::Vector3d facing = Eigen::Vector3d::UnitZ();
  std::vector<double> angles;
  double error_facing = 0.0;
  double error_wall = 0.0;
  for (const Corner& corner : Corners()) {
    const auto sideways = std::span(corner.views).first(2);
    const Eigen::Vector3d normal =
        refiner_.EstimateNormal(corner.reference, sideways, corner.point, facing);
    EXPECT_NEAR(normal.norm(), 1.0, 1e-9);
    for (size_t k = 0; k < sideways.size(); ++k) {
      const auto plain = refiner_.Align(corner.reference, sideways[k], corner.point, facing);
      const auto truer = refiner_.Align(corner.reference, sideways[k], corner.point, normal);
      if (!plain || !truer) continue;
      angles.push_back(std::acos(std::min(1.0, normal.dot(normal_))));
      error_facing += (*plain - corner.truths[k]).squaredNorm();
      error_wall += (*truer - corner.truths[k]).squaredNorm();
    }
  }
  ASSERT_GT(angles.size(), 50U);
  std::nth_element(angles.begin(), angles.begin() + angles.size() / 2, angles.end());
  EXPECT_LT(angles[angles.size() / 2], 8.0 * std::numbers::pi / 180.0);  // 53 degrees at the start
  EXPECT_LT(error_wall, 0.25 * error_facing);
}

TEST_F(ObliqueWallTest, PerspectiveDoesNotShiftPlaces) {
  double shift = 0.0;  // Mean along the direction in which the wall recedes [px of the level].
  int count = 0;
  for (const Corner& corner : Corners()) {
    const PatchView& nearer = corner.views.back();
    const auto found = refiner_.Align(corner.reference, nearer, corner.point, normal_);
    if (!found) continue;
    const double scale = std::pow(features_.scale_factor, nearer.level);
    shift += (found->x() - corner.truths.back().x()) / scale;
    ++count;
  }
  ASSERT_GT(count, 50);
  EXPECT_LT(std::abs(shift / count), 0.002);  // An affine map would shift by 0.005.
}

TEST_F(ObliqueWallTest, NormalFacesTheCamerasWithoutEvidence) {
  const Eigen::Vector3d facing = Eigen::Vector3d::UnitZ();
  const PatchView reference{&reference_, {}, {320.5, 240.5}, 0};
  EXPECT_EQ(refiner_.EstimateNormal(reference, {}, {0.0, 0.0, 3.0}, facing), facing);
}

}  // namespace
}  // namespace s3lam
