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

/// Points all over the image of a camera at the origin, whose descriptors resemble one another as
/// those of a meadow do.
testing::PointCloud MakeMeadow(const Undistorter& undistorter, int count) {
  constexpr int kBytesOfItsOwn = 18;
  Rng rng(5);
  testing::PointCloud cloud;
  const BinaryDescriptor common = testing::MakeDescriptor(rng);
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2d pixel(rng.Uniform(1.0, undistorter.camera().width - 1.0),
                                rng.Uniform(1.0, undistorter.camera().height - 1.0));
    cloud.points.push_back(rng.Uniform(3.0, 7.0) *
                           undistorter.intrinsics().Normalize(pixel).homogeneous());
    BinaryDescriptor descriptor = common;
    for (int byte = 0; byte < kBytesOfItsOwn; ++byte) {
      descriptor[static_cast<size_t>(byte)] = static_cast<uint8_t>(rng.Below(256));
    }
    cloud.descriptors.push_back(descriptor);
  }
  return cloud;
}

TEST(Track, IsNotMisledByMatchesThatFitByChance) {
  const Undistorter undistorter(testing::MakeTestCamera(CameraModel::kPinhole));
  Rng rng(2);
  const testing::PointCloud cloud = MakeMeadow(undistorter, 1500);
  // A turn by far more than the search windows, which the motion so far does not tell.
  const Rigid3 turned{QuaternionFromRotationVector(Eigen::Vector3d(0.0, 0.15, 0.0)), {}};
  std::vector<FrameFeatures> frames{testing::SeeCloud(cloud, {}, undistorter, 0.0, rng),
                                    testing::SeeCloud(cloud, turned, undistorter, 0.5, rng)};
  ASSERT_EQ(frames[0].size(), static_cast<int>(cloud.points.size()));
  Map map(frames, FeatureOptions{});
  FrameTrack last;
  last.tracked = true;
  last.reference_keyframe = map.AddKeyframe(0, {});
  for (int i = 0; i < frames[0].size(); ++i) {
    const int point = map.AddPoint(cloud.points[static_cast<size_t>(i)], last.reference_keyframe);
    map.AddObservation(point, {last.reference_keyframe, i});
    map.UpdateAppearance(point);
    map.UpdateGeometry(point);
    last.matches.push_back({i, point});
  }
  const TrackerOptions options;
  const Tracker tracker(options, undistorter);
  const FrameTrack misled = tracker.TrackNear(map, 1, last, {});
  ASSERT_TRUE(misled.tracked);
  EXPECT_GT(RotationAngle(misled.cam_from_world.rotation, turned.rotation), 0.05);
  const FrameTrack track = tracker.Track(map, 1, last, {});
  ASSERT_TRUE(track.tracked);
  EXPECT_LT(RotationAngle(track.cam_from_world.rotation, turned.rotation), 0.001);
  EXPECT_GT(track.matches.size(), 1000U);
}

/// A place is told by most of what is there: the same door sign in another corridor is not one.
TEST(Relocalize, WantsMoreOfWhatShouldBeVisibleThanChanceFinds) {
  constexpr int kPoints = 900;
  const Undistorter undistorter(testing::MakeTestCamera(CameraModel::kPinhole));
  Rng rng(2);
  const testing::PointCloud here = MakeMeadow(undistorter, kPoints);
  for (const int in_common : {90, 270}) {
    testing::PointCloud there = here;
    for (size_t i = static_cast<size_t>(in_common); i < kPoints; ++i) {
      there.descriptors[i] = testing::MakeDescriptor(rng);
    }
    std::vector<FrameFeatures> frames{testing::SeeCloud(here, {}, undistorter, 0.0, rng),
                                      testing::SeeCloud(there, {}, undistorter, 0.5, rng)};
    Map map(frames, FeatureOptions{});
    const int keyframe = map.AddKeyframe(0, {});
    for (int i = 0; i < frames[0].size(); ++i) {
      const int point = map.AddPoint(here.points[static_cast<size_t>(i)], keyframe);
      map.AddObservation(point, {keyframe, i});
      map.UpdateAppearance(point);
      map.UpdateGeometry(point);
    }
    const TrackerOptions options;
    const FrameTrack track = Tracker(options, undistorter).Relocalize(map, 1, keyframe);
    EXPECT_EQ(track.tracked, in_common == 270) << in_common;
  }
}

}  // namespace
}  // namespace s3lam
