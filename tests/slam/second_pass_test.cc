#include "s3lam/slam/second_pass.h"

#include <gtest/gtest.h>

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
