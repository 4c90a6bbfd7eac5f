#include "s3lam/slam/second_pass.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "s3lam/slam/pipeline.h"
#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

class KeyframeFeaturesTest : public ::testing::Test {
 protected:
  KeyframeFeaturesTest() : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)) {
    const Camera& camera = undistorter_.camera();
    image_ = testing::MakeTexture(camera.width, camera.height, 3);
    features_.num_features = 300;
    frames_.push_back(ExtractFeatures(features_, undistorter_, image_));
    images_.read_gray = [this](size_t) { return image_; };
  }

  Undistorter undistorter_;
  FeatureOptions features_;
  cv::Mat image_;
  std::vector<FrameFeatures> frames_;
  FrameImages images_;
};

TEST_F(KeyframeFeaturesTest, KeepsTheKeypointsThatAreThereAndAddsOthersBesideThem) {
  const FrameFeatures before = frames_[0];
  Map map(frames_, features_);
  map.AddKeyframe(0, {});
  SecondPassOptions options;
  options.keyframe_features = 900;
  const int added = AddKeyframeFeatures(options, features_, undistorter_, images_, 2, map);
  EXPECT_GT(added, 300);
  ASSERT_EQ(frames_[0].size(), before.size() + added);
  ASSERT_EQ(map.keyframe(0).point_of_keypoint.size(), static_cast<size_t>(frames_[0].size()));
  for (int i = 0; i < before.size(); ++i) {
    EXPECT_EQ(frames_[0].keypoint(i).pixel, before.keypoint(i).pixel);
  }
  for (int i = before.size(); i < frames_[0].size(); ++i) {
    const Keypoint& keypoint = frames_[0].keypoint(i);
    EXPECT_EQ(map.keyframe(0).point_of_keypoint[i], kNoIndex);
    for (int j = 0; j < before.size(); ++j) {
      if (before.keypoint(j).level != keypoint.level) continue;
      EXPECT_GT((before.keypoint(j).pixel - keypoint.pixel).norm(), 0.9F * keypoint.sigma);
    }
  }
}

/// Where images are frames of a video, going back means decoding it from its beginning.
TEST_F(KeyframeFeaturesTest, ImagesAreReadInTheOrderOfTime) {
  frames_.resize(4, frames_[0]);
  Map map(frames_, features_);
  for (const int frame : {2, 3, 1, 0}) map.AddKeyframe(frame, {});
  std::vector<size_t> read;
  images_.read_gray = [&](size_t frame) {
    read.push_back(frame);
    return image_;
  };
  SecondPassOptions options;
  options.keyframe_features = 900;
  AddKeyframeFeatures(options, features_, undistorter_, images_, 1, map);
  EXPECT_EQ(read, (std::vector<size_t>{0, 1, 2, 3}));
  read.clear();
  const PatchPass pass(options, features_, undistorter_, images_, 1, map);
  EXPECT_TRUE(std::is_sorted(read.begin() + 1, read.end()));  // The first tells the size.
  EXPECT_EQ(read.size(), 5u);
}

TEST_F(KeyframeFeaturesTest, AddsNothingWhereTheMaskForbids) {
  Map map(frames_, features_);
  map.AddKeyframe(0, {});
  images_.read_mask = [this](size_t) { return cv::Mat(image_.size(), CV_8UC1, cv::Scalar(0)); };
  SecondPassOptions options;
  options.keyframe_features = 900;
  EXPECT_EQ(AddKeyframeFeatures(options, features_, undistorter_, images_, 1, map), 0);
}

TEST_F(KeyframeFeaturesTest, AddsNothingWhenTrackingHasAsMany) {
  Map map(frames_, features_);
  map.AddKeyframe(0, {});
  SecondPassOptions options;
  options.keyframe_features = features_.num_features;
  EXPECT_EQ(AddKeyframeFeatures(options, features_, undistorter_, images_, 1, map), 0);
}

/// A textured wall seen by two keyframes and a frame, side by side.
class AlignFrameTest : public ::testing::Test {
 protected:
  static constexpr double kDepth = 4.0;
  static constexpr double kDisparity = 6.3;  // px between neighbours
  static constexpr int kFrame = 2;

  AlignFrameTest() : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)) {
    const Camera& camera = undistorter_.camera();
    const cv::Mat texture = testing::MakeTexture(camera.width, camera.height, 5);
    for (int i = 0; i < 3; ++i) {
      const cv::Matx23d shift(1.0, 0.0, -i * kDisparity, 0.0, 1.0, 0.0);
      cv::warpAffine(texture, pictures_.emplace_back(), shift, texture.size(), cv::INTER_CUBIC,
                     cv::BORDER_REPLICATE);
      frames_.push_back(ExtractFeatures(features_, undistorter_, pictures_.back()));
    }
    images_.read_gray = [this](size_t i) { return pictures_[i]; };
  }

  [[nodiscard]] Rigid3 PoseOf(int frame) const {
    Rigid3 pose;
    pose.translation.x() = -frame * kDisparity * kDepth / undistorter_.intrinsics().fx;
    return pose;
  }

  /// A map of what the keyframes see, and the frame's matches with it, half a pixel off.
  void FillMap(Map& map) {
    map.AddKeyframe(0, PoseOf(0));
    map.AddKeyframe(1, PoseOf(1));
    const int count = frames_[0].size();
    for (int i = 0; i < count; i += 4) {
      const Keypoint first = frames_[0].keypoint(i);
      const Eigen::Vector2d pixel = first.pixel.cast<double>();
      const int point = map.AddPoint(
          kDepth * undistorter_.intrinsics().Normalize(pixel).homogeneous(), /*first_keyframe=*/0);
      map.SetNormal(point, Eigen::Vector3d::UnitZ());
      const Eigen::Vector2d moved = pixel - Eigen::Vector2d(kDisparity, 0.0);
      map.AddObservation(point, {0, i});
      Keypoint second = first;
      second.pixel = second.undistorted = moved.cast<float>();
      map.AddObservation(point, {1, map.AddKeypoint(1, second, frames_[0].descriptor(i))});
      map.UpdateAppearance(point);
      truth_.push_back(moved - Eigen::Vector2d(kDisparity, 0.0));
      Keypoint third = first;
      third.pixel = third.undistorted = truth_.back().cast<float>() + Eigen::Vector2f(0.4F, -0.3F);
      matches_.push_back({frames_[kFrame].Add(third, frames_[0].descriptor(i)), point});
    }
  }

  Undistorter undistorter_;
  FeatureOptions features_;
  SecondPassOptions options_;
  std::vector<cv::Mat> pictures_;
  std::vector<FrameFeatures> frames_;
  FrameImages images_;
  std::vector<PointMatch> matches_;
  std::vector<Eigen::Vector2d> truth_;
};

TEST_F(AlignFrameTest, MovesKeypointsToWhereTheKeyframesPatchesAre) {
  Map map(frames_, features_);
  map.SetAlignedSigmas(LevelSigmas(features_));
  FillMap(map);
  const PatchPass pass(options_, features_, undistorter_, images_, 1, map);
  const size_t given = matches_.size();
  pass.AlignFrame(kFrame, BuildPyramid(features_, pictures_[kFrame]), map, PoseOf(kFrame),
                  matches_);
  EXPECT_GT(matches_.size(), given * 7 / 10);
  double squared = 0.0;
  for (const PointMatch& match : matches_) {
    const Keypoint& keypoint = frames_[kFrame].keypoint(match.keypoint);
    const Eigen::Vector2d error = keypoint.pixel.cast<double>() - truth_[match.point];
    const double level_sigma = map.sigma(keypoint.level);
    squared += error.squaredNorm() / (level_sigma * level_sigma);
    EXPECT_NEAR(keypoint.sigma, map.aligned_sigma(keypoint.level), 1e-6);
  }
  EXPECT_LT(std::sqrt(squared / static_cast<double>(matches_.size())), 0.15);  // Was 0.5.
}

TEST_F(AlignFrameTest, FrameThatShowsSomethingElseKeepsItsMatches) {
  Map map(frames_, features_);
  map.SetAlignedSigmas(LevelSigmas(features_));
  FillMap(map);
  const PatchPass pass(options_, features_, undistorter_, images_, 1, map);
  const std::vector<PointMatch> given = matches_;
  const cv::Mat other = testing::MakeTexture(pictures_[0].cols, pictures_[0].rows, 77);
  pass.AlignFrame(kFrame, BuildPyramid(features_, other), map, PoseOf(kFrame), matches_);
  EXPECT_EQ(matches_.size(), given.size());
}

/// Points of all levels, seen by a row of keyframes.
class AlignedSigmasTest : public ::testing::Test {
 protected:
  static constexpr int kKeyframes = 12;

  AlignedSigmasTest() : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)) {
    const cv::Mat blank(undistorter_.camera().height, undistorter_.camera().width, CV_8UC1,
                        cv::Scalar(0));
    for (int k = 0; k < kKeyframes; ++k) {
      frames_.push_back(ExtractFeatures(features_, undistorter_, blank));
    }
  }

  /// With keypoints off by a noise that grows by `growth` from level to level, one of ten wrong.
  void FillMap(double noise_px, double growth, Map& map) {
    Rng rng(3);
    for (int k = 0; k < kKeyframes; ++k) {
      Rigid3 pose;
      pose.translation.x() = 0.1 * k;
      map.AddKeyframe(k, pose);
    }
    for (int i = 0; i < 800; ++i) {
      const Eigen::Vector3d x(rng.Uniform(-0.5, 0.5), rng.Uniform(-1.0, 1.0),
                              rng.Uniform(4.0, 6.0));
      const int point = map.AddPoint(x, /*first_keyframe=*/0);
      for (int k = 0; k < kKeyframes; ++k) {
        Keypoint keypoint;
        keypoint.level = static_cast<uint8_t>(i % map.num_levels());
        const double sigma = noise_px * std::pow(growth, keypoint.level);
        const Eigen::Vector2d pixel =
            *undistorter_.camera().ImageFromCamera(map.keyframe(k).cam_from_world * x) +
            (rng.Below(20) == 0 ? 20.0 : 1.0) * sigma *
                Eigen::Vector2d(rng.Gaussian(), rng.Gaussian());
        keypoint.pixel = keypoint.undistorted = pixel.cast<float>();
        keypoint.sigma = static_cast<float>(map.aligned_sigma(keypoint.level));
        map.AddObservation(point, {k, map.AddKeypoint(k, keypoint, {})});
      }
    }
  }

  Undistorter undistorter_;
  FeatureOptions features_;
  AlignmentNoiseOptions options_;
  std::vector<FrameFeatures> frames_;
};

TEST_F(AlignedSigmasTest, AreWhatTheResidualsOfEachLevelShow) {
  Map map(frames_, features_);
  map.SetAlignedSigmas(LevelSigmas(features_));
  FillMap(0.3, 1.1, map);
  MeasureAlignedSigmas(options_, undistorter_, map);
  for (int level = 0; level < map.num_levels(); ++level) {
    EXPECT_NEAR(map.aligned_sigma(level) / (0.3 * std::pow(1.1, level)), 1.1, 0.15) << level;
  }
  const MapObservation& o = map.point(11).observations[5];
  EXPECT_FLOAT_EQ(map.keypoint(o).sigma, static_cast<float>(map.aligned_sigma(11 % 8)));
}

TEST_F(AlignedSigmasTest, AreNeverLessThanImagesAllow) {
  Map map(frames_, features_);
  map.SetAlignedSigmas(LevelSigmas(features_));
  FillMap(1e-4, 1.0, map);
  MeasureAlignedSigmas(options_, undistorter_, map);
  for (int level = 0; level < map.num_levels(); ++level) {
    EXPECT_DOUBLE_EQ(map.aligned_sigma(level), options_.min_sigma_px * map.sigma(level));
  }
}

TEST_F(AlignedSigmasTest, StayWhereTooFewResidualsSpeak) {
  Map map(frames_, features_);
  map.SetAlignedSigmas(LevelSigmas(features_));
  FillMap(0.3, 1.0, map);
  options_.min_residuals = 100000;
  MeasureAlignedSigmas(options_, undistorter_, map);
  for (int level = 0; level < map.num_levels(); ++level) {
    EXPECT_DOUBLE_EQ(map.aligned_sigma(level), map.sigma(level));
  }
}

TEST(EffectiveTest, FastLeavesStepsAndKeyframesOutAndHighChangesNothing) {
  slam::Options options;
  const slam::Options high = slam::Effective(options);
  EXPECT_EQ(high.second_pass.patches.enabled, options.second_pass.patches.enabled);
  EXPECT_EQ(high.second_pass.keyframe_features, options.second_pass.keyframe_features);
  EXPECT_EQ(high.self_calibration.enabled, options.self_calibration.enabled);
  options.accuracy = slam::Accuracy::kFast;
  const slam::Options fast = slam::Effective(options);
  EXPECT_FALSE(fast.second_pass.patches.enabled);
  EXPECT_EQ(fast.second_pass.keyframe_features, 0);
  EXPECT_FALSE(fast.self_calibration.enabled);
  EXPECT_LT(fast.tracker.keyframe_ratio, high.tracker.keyframe_ratio);
  EXPECT_LT(fast.tracker.min_coverage, high.tracker.min_coverage);
  options.tracker.min_coverage = 0.5;
  EXPECT_EQ(slam::Effective(options).tracker.min_coverage, 0.5);
}

}  // namespace
}  // namespace s3lam
