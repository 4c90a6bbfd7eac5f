#include "s3lam/slam/report.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

namespace s3lam::slam {
namespace {

std::vector<FrameReport> MakeFrames(std::initializer_list<std::tuple<int, int, double>> runs) {
  std::vector<FrameReport> frames;
  for (const auto& [count, map, trust] : runs) {
    for (int i = 0; i < count; ++i) {
      FrameReport frame;
      frame.map = map;
      frame.trust = trust;
      frames.push_back(frame);
    }
  }
  return frames;
}

TEST(FrameTrust, FallsWithFewPointsInOneCornerThatFitBadlyOrContradictions) {
  const auto trust = [](int inliers, double spread, double rms_sigma, double contradiction) {
    FrameReport frame;
    frame.num_inliers = inliers;
    frame.spread = spread;
    frame.rms_sigma = rms_sigma;
    frame.contradiction = contradiction;
    return FrameTrust(frame);
  };
  EXPECT_EQ(trust(300, 1.0, 0.7, 0.0), 1.0);
  EXPECT_NEAR(trust(30, 1.0, 0.7, 0.0), 0.5, 1e-12);
  EXPECT_NEAR(trust(300, 0.25, 0.7, 0.0), 0.5, 1e-12);
  EXPECT_NEAR(trust(300, 1.0, 2.0, 0.0), 0.5, 1e-12);
  EXPECT_NEAR(trust(300, 1.0, 0.7, 0.02), 0.5, 1e-12);
  EXPECT_EQ(trust(300, 1.0, 0.7, 0.3), 0.0);
  EXPECT_EQ(trust(0, 0.0, 0.0, 0.0), 0.0);
}

TEST(FrameTrust, IsLittleWhereAFrameIsCutOff) {
  FrameReport frame;
  frame.map = 0;
  frame.num_inliers = 300;
  frame.spread = 1.0;
  frame.is_cut_off = true;
  EXPECT_EQ(FrameTrust(frame), 0.4);
  frame.trust = FrameTrust(frame);
  const auto stretches = FindStretches(std::vector<FrameReport>(9, frame));
  ASSERT_EQ(stretches.size(), 1U);
  EXPECT_EQ(stretches.front().state, StretchReport::State::kWeak);
  EXPECT_EQ(stretches.front().doubt, StretchReport::Doubt::kCutOff);
}

TEST(Report, TellsAMapThatIsMostlyRefuted) {
  std::vector<FrameReport> frames = MakeFrames({{6, 0, 1.0}, {3, 1, 1.0}, {20, -1, 0.0}});
  EXPECT_FALSE(IsMostlyRefuted(frames));
  for (int i = 0; i < 9; ++i) frames[static_cast<size_t>(i)].contradiction = i < 3 ? 0.0 : 0.3;
  EXPECT_FALSE(IsMostlyRefuted(frames));  // Half of it, and another map.
  frames[2].contradiction = 0.3;
  EXPECT_TRUE(IsMostlyRefuted(frames));
  EXPECT_FALSE(IsMostlyRefuted({}));
}

TEST(FocalReport, SigmaHoldsNoiseAndWhatPartsDifferByAndHaveInCommon) {
  FocalReport focal;
  focal.refined = 500.0;
  focal.noise_sigma = 1.0;
  EXPECT_NEAR(focal.Sigma(), std::hypot(1.0, 5.0), 1e-12);
  EXPECT_TRUE(focal.IsDetermined());
  focal.parts_sigma = 9.0;
  EXPECT_NEAR(focal.Sigma(), std::hypot(1.0, 9.0, 5.0), 1e-12);
  EXPECT_FALSE(focal.IsDetermined());
}

TEST(Report, TellsOfManyFramesLostIfTheCameraWasNotKnown) {
  Report report;
  report.num_frames = 100;
  report.frames = MakeFrames({{70, 0, 0.9}, {30, -1, 0.0}});
  EXPECT_FALSE(LosesFramesOfUnknownCamera(report));
  report.focal.emplace();
  EXPECT_TRUE(LosesFramesOfUnknownCamera(report));
  report.frames = MakeFrames({{50, 0, 0.9}, {40, 1, 0.9}, {10, -1, 0.0}});
  EXPECT_FALSE(LosesFramesOfUnknownCamera(report));
}

TEST(Stretches, AreCutWhereMapOrTrustChange) {
  const auto stretches = FindStretches(MakeFrames(
      {{20, 0, 0.9}, {3, 0, 0.1}, {20, 0, 0.8}, {10, 0, 0.2}, {7, -1, 0.0}, {9, 1, 1.0}}));
  ASSERT_EQ(stretches.size(), 4U);
  EXPECT_EQ(stretches[0].last_frame, 42);  // Three weak frames do not make a stretch,
  EXPECT_EQ(stretches[0].state, StretchReport::State::kGood);
  EXPECT_EQ(stretches[0].min_trust, 0.1);  // but are not hidden.
  EXPECT_EQ(stretches[1].state, StretchReport::State::kWeak);
  EXPECT_EQ(stretches[2].state, StretchReport::State::kLost);
  EXPECT_EQ(stretches[2].first_frame, 53);
  EXPECT_EQ(stretches[3].map, 1);
  EXPECT_NEAR(stretches[3].mean_trust, 1.0, 1e-12);
  EXPECT_EQ(stretches[3].last_frame, 68);
}

TEST(Stretches, AreWeakOnlyIfTheirMeanTrustIs) {
  const auto stretches = FindStretches(
      MakeFrames({{5, 0, 0.4}, {4, 0, 1.0}, {1, 0, 0.4}, {4, 0, 1.0}, {6, 0, 0.1}, {2, 0, 0.6}}));
  for (const StretchReport& stretch : stretches) {
    EXPECT_EQ(stretch.state == StretchReport::State::kGood, stretch.mean_trust >= 0.5)
        << stretch.first_frame;
  }
  ASSERT_EQ(stretches.size(), 3U);
  EXPECT_EQ(stretches[0].state, StretchReport::State::kWeak);
  EXPECT_EQ(stretches[1].first_frame, 5);  // Few, but they would belie what is around them.
  EXPECT_EQ(stretches[1].last_frame, 13);
  EXPECT_EQ(stretches[2].last_frame, 21);
}

TEST(Stretches, OfLittleTrustSayWhy) {
  using Doubt = StretchReport::Doubt;
  const auto doubt = [](int inliers, double spread, double rms_sigma, double contradiction) {
    FrameReport frame;
    frame.map = 0;
    frame.num_inliers = inliers;
    frame.spread = spread;
    frame.rms_sigma = rms_sigma;
    frame.contradiction = contradiction;
    frame.trust = FrameTrust(frame);
    const auto stretches = FindStretches(std::vector<FrameReport>(9, frame));
    EXPECT_EQ(stretches.size(), 1U);
    return stretches.front().doubt;
  };
  EXPECT_EQ(doubt(300, 1.0, 0.7, 0.0), std::nullopt);
  EXPECT_EQ(doubt(12, 0.4, 1.1, 0.01), Doubt::kFewPoints);
  EXPECT_EQ(doubt(50, 0.1, 1.1, 0.01), Doubt::kSmallPart);
  EXPECT_EQ(doubt(50, 0.4, 3.0, 0.01), Doubt::kLargeResiduals);
  EXPECT_EQ(doubt(50, 0.4, 1.1, 0.04), Doubt::kRefuted);
  EXPECT_EQ(FindStretches(MakeFrames({{9, -1, 0.0}})).front().doubt, std::nullopt);
}

TEST(Stretches, SayInTheReportWhyTheyAreLittleTrusted) {
  Report report;
  report.frames = MakeFrames({{9, 0, 0.2}, {9, 0, 0.9}});
  for (FrameReport& frame : report.frames) frame.spread = 1.0;  // But no points are seen.
  report.stretches = FindStretches(report.frames);
  const nlohmann::json stretches = ToJson(report)["stretches"];
  EXPECT_EQ(stretches[0]["doubt"], "few points");
  EXPECT_TRUE(stretches[1]["doubt"].is_null());
}

TEST(Stretches, OneLostFrameIsAStretch) {
  EXPECT_EQ(FindStretches(MakeFrames({{9, 0, 0.9}, {1, -1, 0.0}, {9, 0, 0.9}})).size(), 3U);
  EXPECT_TRUE(FindStretches({}).empty());
}

}  // namespace
}  // namespace s3lam::slam
