#include "s3lam/slam/tracker.h"

#include <gtest/gtest.h>

#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

TEST(NeedsKeyframe, WhereHalfOfTheImageShowsWhatIsNotMapped) {
  const Undistorter undistorter(testing::MakeTestCamera(CameraModel::kPinhole));
  Rng rng(2);
  const testing::PointCloud cloud = testing::MakeCloud(2000, /*planar=*/true, 1);
  std::vector<FrameFeatures> frames{testing::SeeCloud(cloud, {}, undistorter, 0.0, rng)};
  Map map(frames, FeatureOptions{});
  FrameTrack everywhere;
  everywhere.reference_keyframe = map.AddKeyframe(0, {});
  FrameTrack on_the_left = everywhere;
  for (int i = 0; i < frames[0].size(); ++i) {
    everywhere.matches.push_back({i, i});
    if (frames[0].keypoint(i).pixel.x() < 0.5F * static_cast<float>(undistorter.camera().width)) {
      on_the_left.matches.push_back({i, i});
    }
  }
  const TrackerOptions options;
  const Tracker tracker(options, undistorter);
  EXPECT_FALSE(tracker.NeedsKeyframe(map, 0, everywhere, 1));
  EXPECT_TRUE(tracker.NeedsKeyframe(map, 0, on_the_left, 1));
  EXPECT_TRUE(tracker.NeedsKeyframe(map, 0, everywhere, options.max_keyframe_gap));
}

}  // namespace
}  // namespace s3lam
