#include "s3lam/report/frame_trust.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "report/report_fixture.h"
#include "s3lam/report/trust_strip.h"

namespace s3lam::report {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

json Stretch(int first, int last, int map, const char* state, double mean_trust) {
  return {{"frames", {first, last}}, {"map", map}, {"state", state}, {"mean_trust", mean_trust}};
}

/// Ten frames, all localised and all good but for frames 4 to 9.
json SlamReport() {
  json frames = json::array();
  for (int i = 0; i < 10; ++i) {
    frames.push_back({{"map", 0}, {"keyframe", i % 2 == 0}, {"trust", i < 4 ? 1.0 : 0.25}});
  }
  return {{"stretches", {Stretch(0, 3, 0, "good", 1.0), Stretch(4, 9, 0, "weak", 0.25)}},
          {"per_frame", std::move(frames)},
          {"better_pinhole", json::array()},
          {"pinhole_cost_share", 0.01},
          {"focal_length", {{"determined", true}, {"refined_px", 500.0}, {"sigma_px", 5.0}}},
          {"images_left_out", json::array()},
          {"maps", json::array({{{"folder", "."}}})}};
}

RunFolder RunOf(const json& slam, const json& refined = {}) {
  RunFolder run;
  run.stages = {{"1_slam", slam, {}}, {"3_refine", refined, {}}};
  return run;
}

std::vector<std::string> DoubtsOf(const RunFolder& run) {
  return DescribeDoubts(run, ReadFrameTrust(run));
}

Arm ArmOfPoses(size_t count) {
  Arm arm;
  arm.trajectory.resize(count);
  return arm;
}

TEST(FrameTrust, StretchesAndFrames) {
  const FrameTrust trust = ReadFrameTrust(RunOf(SlamReport()));
  ASSERT_EQ(trust.stretches.size(), 2U);
  EXPECT_EQ(trust.stretches[1].first, 4);
  EXPECT_EQ(trust.stretches[1].state, FrameState::kWeak);
  EXPECT_EQ(trust.NumFrames(), 10);
  ASSERT_EQ(trust.frames.size(), 10U);
  EXPECT_TRUE(trust.frames[2].is_keyframe);
  EXPECT_EQ(trust.frames[4].trust, 0.25);
}

TEST(FrameTrust, ReportsThatTellNothingOfIt) {
  for (const json& report : {json(), json::object(), json{{"stretches", 3}, {"per_frame", "x"}}}) {
    const RunFolder run = RunOf(report);
    EXPECT_THAT(ReadFrameTrust(run).stretches, IsEmpty());
    EXPECT_THAT(DoubtsOf(run), IsEmpty());
  }
  EXPECT_THAT(DoubtsOf(RunFolder{}), IsEmpty());
}

TEST(FrameTrust, WhatCannotBeIsLeftOut) {
  const auto stretches_of = [](const json& list) {
    return ReadFrameTrust(RunOf({{"stretches", list}})).stretches;
  };
  EXPECT_EQ(stretches_of(json::array({Stretch(0, 3, 0, "good", 1.0)})).size(), 1U);
  EXPECT_THAT(stretches_of(json::array({Stretch(1, 3, 0, "good", 1.0)})), IsEmpty());
  EXPECT_THAT(stretches_of(json::array({Stretch(0, -1, 0, "good", 1.0)})), IsEmpty());
  EXPECT_THAT(stretches_of(json::array({Stretch(0, 3, 0, "odd", 1.0)})), IsEmpty());
  EXPECT_THAT(stretches_of({Stretch(0, 3, 0, "good", 1.0), Stretch(5, 6, 0, "weak", 0.0)}),
              IsEmpty());
  EXPECT_THAT(stretches_of(json::array({{{"frames", {0, 1e300}}, {"state", "good"}}})), IsEmpty());
  json report = SlamReport();
  report["per_frame"].erase(3);
  EXPECT_THAT(ReadFrameTrust(RunOf(report)).frames, IsEmpty());
}

TEST(FrameTrust, StatesOfAllFramesOrOfKeyframes) {
  json report = SlamReport();
  report["stretches"] = {Stretch(0, 3, 0, "good", 1.0), Stretch(4, 4, -1, "lost", 0.0),
                         Stretch(5, 9, 0, "weak", 0.25)};
  report["per_frame"][4]["map"] = -1;
  const FrameTrust trust = ReadFrameTrust(RunOf(report));
  const auto states = StatesOfTrajectory(trust, ArmOfPoses(9));
  ASSERT_EQ(states.size(), 9U);
  EXPECT_EQ(states[3], FrameState::kGood);
  EXPECT_EQ(states[4], FrameState::kWeak);
  EXPECT_THAT(
      StatesOfTrajectory(trust, ArmOfPoses(4)),
      ElementsAre(FrameState::kGood, FrameState::kGood, FrameState::kWeak, FrameState::kWeak));
  EXPECT_THAT(StatesOfTrajectory(trust, ArmOfPoses(7)), IsEmpty());
}

TEST(Doubts, NoneOfAGoodRun) {
  json report = SlamReport();
  report["stretches"] = json::array({Stretch(0, 9, 0, "good", 1.0)});
  EXPECT_THAT(DoubtsOf(RunOf(report)), IsEmpty());
}

TEST(Doubts, LittleTrustedAndLostFrames) {
  json report = SlamReport();
  report["stretches"].push_back(Stretch(10, 10, -1, "lost", 0.0));
  report["stretches"].push_back(Stretch(11, 19, 0, "weak", 0.05));
  EXPECT_THAT(
      DoubtsOf(RunOf(report)),
      ElementsAre("Little trusted: frames 4 to 9, 11 to 19 (15 of 20, mean trust 0.13 of 1).",
                  "Not localised: frames 10 (1 of 20)."));
}

TEST(Doubts, ManyStretchesAreCounted) {
  json report;
  for (int i = 0; i < 40; ++i) {
    report["stretches"].push_back(Stretch(i, i, 0, i % 2 == 0 ? "weak" : "good", 0.5));
  }
  EXPECT_THAT(DoubtsOf(RunOf(report)),
              ElementsAre(AllOf(HasSubstr("12, 14 and 12 more (20 of 40"), Not(HasSubstr("16")))));
}

TEST(Doubts, MapsApart) {
  json report = SlamReport();
  report["stretches"] = json();
  report["maps"].push_back(
      {{"folder", "1"}, {"frames_localized", 96}, {"first_frame", 99}, {"last_frame", 194}});
  EXPECT_THAT(DoubtsOf(RunOf(report)),
              ElementsAre(HasSubstr("1_slam/1 (96 of the frames 99 to 194)")));
}

TEST(Doubts, CalibrationAndFocalLength) {
  json report = SlamReport();
  report["stretches"] = json();
  report["focal_length"]["determined"] = false;
  report["better_pinhole"] = {510.0, 511.0, 320.0, 240.0};
  report["pinhole_cost_share"] = 0.25;
  const json camera = {{"cameras", json::array({7})},
                       {"refined", false},
                       {"better_pinhole", {610.0, 611.0, 320.0, 240.0}},
                       {"pinhole_cost_share", 0.5}};
  const auto doubts = DoubtsOf(RunOf(report, {{"cameras", json::array({camera})}}));
  EXPECT_THAT(
      doubts,
      ElementsAre(AllOf(HasSubstr("focal length"), HasSubstr("500.0 px, sigma 5.0")),
                  AllOf(HasSubstr("in doubt"), HasSubstr("510.0, 511.0"), HasSubstr("25 % of")),
                  AllOf(HasSubstr("of camera 7 in s3-refine"), HasSubstr("610.0"))));
  json refined = camera;
  refined["refined"] = true;
  EXPECT_THAT(DoubtsOf(RunOf({}, {{"cameras", json::array({refined})}})), IsEmpty());
}

TEST(Doubts, RollingShutterThatIsNotCorrected) {
  for (const bool compensated : {false, true}) {
    const json shutter = {{"seen", true}, {"compensated", compensated}};
    EXPECT_EQ(DoubtsOf(RunOf({{"rolling_shutter", shutter}})).size(), compensated ? 0U : 1U);
  }
}

TEST(Doubts, LensDistortion) {
  json camera = {{"cameras", json::array({7})},
                 {"refined", false},
                 {"distortion_cost_share", 0.3},
                 {"distortion_is_doubtful", true}};
  const auto doubts_of = [](const json& of_camera) {
    return DoubtsOf(RunOf({}, {{"cameras", json::array({of_camera})}}));
  };
  EXPECT_THAT(doubts_of(camera),
              ElementsAre(AllOf(HasSubstr("camera 7 in s3-refine is in doubt"),
                                HasSubstr("another lens distortion"), HasSubstr("30 % of"))));
  camera["better_pinhole"] = {610.0, 611.0, 320.0, 240.0};
  EXPECT_THAT(doubts_of(camera), ElementsAre(HasSubstr("lens distortion"), HasSubstr("610.0")));
  camera["distortion_is_doubtful"] = false;
  EXPECT_THAT(doubts_of(camera), ElementsAre(HasSubstr("610.0")));
}

TEST(Doubts, ImagesLeftOut) {
  EXPECT_THAT(
      DoubtsOf(RunOf({{"images_left_out", {"a.png: cannot be decoded", "b.png: too small"}}})),
      ElementsAre(AllOf(HasSubstr("2 images"), HasSubstr("a.png: cannot be decoded"))));
}

/// Of a picture of pixels, at a place of the drawing.
Rgb ColorAt(const cv::Mat& image, int x, int y) {
  const auto bgr = image.at<cv::Vec3b>(y, x);
  return {bgr[2], bgr[1], bgr[0]};
}

// A single lost frame among very many is a column of pixels still.
TEST(TrustStrip, ShowsEveryStretch) {
  constexpr int kBand = 105;
  FrameTrust trust;
  trust.stretches = {{0, 49'999, 0, FrameState::kGood, {}},
                     {50'000, 50'000, 0, FrameState::kLost, {}},
                     {50'001, 74'999, 0, FrameState::kGood, {}},
                     {75'000, 99'999, 0, FrameState::kWeak, {}}};
  const Drawing strip = DrawTrustStrip(trust);
  const cv::Mat image = strip.ToImage();
  std::map<Rgb, int> columns;
  for (int x = 0; x < image.cols; ++x) ++columns[ColorAt(image, x, kBand)];
  EXPECT_GE(columns[StateColor(FrameState::kLost)], 1);
  EXPECT_GT(columns[StateColor(FrameState::kGood)], 800);
  EXPECT_NEAR(columns[StateColor(FrameState::kWeak)], 297, 3);
  EXPECT_THAT(strip.ToSvg(), AllOf(HasSubstr(">50000<"), HasSubstr("little trusted (25000)"),
                                   HasSubstr("not localised (1)")));
}

TEST(TrustStrip, StaysSmall) {
  FrameTrust trust;
  for (int i = 0; i < 50'000; ++i) {
    trust.stretches.push_back({i, i, i % 3, FrameState(i % 3), 0.5});
    trust.frames.push_back({i % 3, false, 0.001 * (i % 997)});
  }
  EXPECT_LT(DrawTrustStrip(trust).ToSvg().size(), 200'000U);
}

// Lightness alone tells the states apart, whatever colours the eye or the printer has.
TEST(TrustStrip, StatesDifferInLightness) {
  const auto lightness = [](FrameState state) {
    const Rgb color = StateColor(state);
    return 0.3 * color[0] + 0.59 * color[1] + 0.11 * color[2];
  };
  EXPECT_GT(lightness(FrameState::kGood), lightness(FrameState::kWeak) + 50.0);
  EXPECT_GT(lightness(FrameState::kWeak), lightness(FrameState::kLost) + 50.0);
}

TEST(TrustInTheReport, IsShownWhereItIsKnown) {
  const testing::RunOnDisk disk;
  Input input = {ReadRunFolder(disk.path()), {}, {}};
  Output output;
  Report report = report::Run(Options(), input, output);
  EXPECT_THAT(report.doubts, IsEmpty());
  EXPECT_THAT(output.html,
              AllOf(Not(HasSubstr("Trust in")), Not(HasSubstr("<ul class=\"doubts\">")),
                    Not(HasSubstr("id=\"trustPath\""))));
  const size_t size_before = output.html.size();

  const auto num_poses = static_cast<int>(input.run.arms.front().trajectory.size());
  json frames = json::array();
  for (int i = 0; i < num_poses; ++i) {
    frames.push_back({{"map", 0}, {"keyframe", true}, {"trust", 0.1}});
  }
  for (StageRecord& stage : input.run.stages) {
    if (stage.folder != "1_slam") continue;
    stage.report["stretches"] = json::array({Stretch(0, num_poses - 1, 0, "weak", 0.1)});
    stage.report["per_frame"] = frames;
    stage.report["images_left_out"] = json::array({"<script>alert(1)</script>"});
  }
  report = report::Run(Options(), input, output);
  EXPECT_EQ(report.doubts.size(), 2U);
  EXPECT_THAT(ToText(report), HasSubstr("Little trusted: frames 0 to 7"));
  EXPECT_EQ(ToJson(report)["doubts"].size(), 2U);
  EXPECT_THAT(output.html, AllOf(HasSubstr("<h2>Trust in the frames</h2>"),
                                 HasSubstr("<li>Little trusted: frames 0 to 7"),
                                 HasSubstr("id=\"trustPath\""), Not(HasSubstr("<script>alert"))));
  EXPECT_EQ(output.figures.front().name, "trust");
  EXPECT_LT(output.html.size(), size_before + 6000);
}

}  // namespace
}  // namespace s3lam::report
