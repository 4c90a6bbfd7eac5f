#include "s3lam/io/ignore_masks.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "s3lam/base/error.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

/// Five pixels: road, car, road, road, void.
PanopticFrame Frame() {
  PanopticFrame frame;
  frame.segment_ids.resize(1, 5);
  frame.segment_ids << 4, 9, 4, 4, kNoSegment;
  frame.segments[4].class_index = 0;
  frame.segments[9].class_index = 1;
  return frame;
}

ClassTable Table() {
  ClassTable table{"test", {}};
  table.classes.push_back({7, "road", false, true, false, 50, SurfaceOrientation::kAny, {}});
  table.classes.push_back({13, "car", true, false, true, 50, SurfaceOrientation::kAny, {}});
  return table;
}

TEST(IgnoreMasks, AreZeroOnThingsThatMove) {
  const cv::Mat mask = MakeIgnoreMask(Frame(), Table(), 0);
  EXPECT_EQ(cv::countNonZero(mask != (cv::Mat_<uint8_t>(1, 5) << 255, 0, 255, 255, 255)), 0);
  const cv::Mat wide = MakeIgnoreMask(Frame(), Table(), 1);
  EXPECT_EQ(cv::countNonZero(wide != (cv::Mat_<uint8_t>(1, 5) << 0, 0, 0, 255, 255)), 0);
}

TEST(IgnoreMasks, AFileIsTheMaskOfEveryImage) {
  const testing::TempDir dir;
  cv::Mat mask(1, 5, CV_8UC1, cv::Scalar(255));
  mask.at<uint8_t>(0, 2) = 0;
  WriteIgnoreMask(mask, dir.path(), "all");
  const auto file = dir / "all.png";
  for (const char* image : {"cam0/1.jpg", "2.jpg"}) {
    EXPECT_TRUE(HasIgnoreMask(file, image));
    EXPECT_EQ(cv::norm(ReadIgnoreMask(file, image, {5, 1}), mask), 0.0);
  }
  EXPECT_THROW(ReadIgnoreMask(file, "2.jpg", {5, 2}), InputError);
}

TEST(IgnoreMasks, AreNamedAsColmapWantsThem) {
  const testing::TempDir dir;
  const cv::Mat mask = MakeIgnoreMask(Frame(), Table(), 0);
  WriteIgnoreMask(mask, dir.path(), "cam0/1.jpg");
  EXPECT_TRUE(std::filesystem::is_regular_file(dir / "cam0/1.jpg.png"));
  const cv::Mat read = ReadIgnoreMask(dir.path(), "cam0/1.jpg", {5, 1});
  EXPECT_EQ(cv::countNonZero(read != mask), 0);
  EXPECT_TRUE(ReadIgnoreMask(dir.path(), "cam0/2.jpg", {5, 1}).empty());
  EXPECT_THROW(ReadIgnoreMask(dir.path(), "cam0/1.jpg", {5, 2}), InputError);
  cv::imwrite((dir / "3.jpg.png").string(), cv::Mat(1, 5, CV_8UC3));
  EXPECT_THROW(ReadIgnoreMask(dir.path(), "3.jpg", {5, 1}), InputError);
}

}  // namespace
}  // namespace s3lam
