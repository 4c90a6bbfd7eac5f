#include "s3lam/slam/stops.h"

#include <gtest/gtest.h>

namespace s3lam::slam {
namespace {

constexpr double kFocal = 500.0;

FrameView ViewAt(double x, double yaw, int map = 0) {
  Rigid3 world_from_cam{QuaternionFromRotationVector({0.0, yaw, 0.0}), {x, 0.0, 0.0}};
  return {map, world_from_cam.Inverse(), 2.0};
}

TEST(Stops, AreToldFromMotionAndByWhetherTheViewTurns) {
  std::vector<std::optional<FrameView>> views;
  double x = 0.0;
  double yaw = 0.0;
  const auto add = [&](int count, double step, double turn) {
    for (int i = 0; i < count; ++i) {
      x += step;
      yaw += turn;
      views.emplace_back(ViewAt(x, yaw));
    }
  };
  add(30, 0.02, 0.01);  // 5 px a frame.
  add(20, 1e-5, 0.0);   // Stands, but for noise.
  add(30, 0.02, 0.0);
  add(15, 0.0, 0.02);  // Turns.
  add(30, 0.02, 0.02);
  add(5, 0.0, 0.0);  // Too short to be told.
  add(30, -0.02, 0.0);
  const auto stops = FindStops(views, kFocal);
  ASSERT_EQ(stops.size(), 2U);
  EXPECT_EQ(stops[0].kind, StopReport::Kind::kStandstill);
  EXPECT_EQ(stops[0].first_frame, 29);  // The frame where it came to a stop.
  EXPECT_EQ(stops[0].last_frame, 49);
  EXPECT_LT(stops[0].turn_deg, 0.01);
  EXPECT_EQ(stops[1].kind, StopReport::Kind::kRotation);
  EXPECT_EQ(stops[1].first_frame, 79);
  EXPECT_EQ(stops[1].last_frame, 94);
  EXPECT_NEAR(stops[1].turn_deg, 15 * 0.02 * 57.29578, 1e-3);
}

TEST(Stops, OfOneThatStandsEndWhenItSetsOff) {
  std::vector<std::optional<FrameView>> views(50, ViewAt(0.0, 0.0));
  for (int i = 1; i <= 5; ++i) views.emplace_back(ViewAt(6e-4 * i, 1e-3 * i));  // Slowly at first.
  for (int i = 1; i <= 20; ++i) views.emplace_back(ViewAt(0.02 * i, 5e-3));
  const auto stops = FindStops(views, kFocal);
  ASSERT_EQ(stops.size(), 1U);
  EXPECT_EQ(stops[0].kind, StopReport::Kind::kStandstill);
  EXPECT_GE(stops[0].last_frame, 49);
  EXPECT_LE(stops[0].last_frame, 51);
  EXPECT_LT(stops[0].turn_deg, 0.15);
}

TEST(Stops, EndWhereFramesAreLostOrTheMapChanges) {
  std::vector<std::optional<FrameView>> views(25, ViewAt(0.0, 0.0));
  views[12] = std::nullopt;
  for (size_t i = 20; i < views.size(); ++i) views[i] = ViewAt(0.0, 0.0, 1);
  const auto stops = FindStops(views, kFocal);
  ASSERT_EQ(stops.size(), 1U);
  EXPECT_EQ(stops[0].last_frame, 11);
  EXPECT_TRUE(FindStops({}, kFocal).empty());
}

}  // namespace
}  // namespace s3lam::slam
