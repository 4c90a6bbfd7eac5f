#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <limits>

#include "s3lam/base/error.h"
#include "s3lam/base/options_json.h"

namespace s3lam {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

enum class Mode { kOff, kFixed };
constexpr std::array<std::string_view, 2> kModeNames = {"off", "fixed"};

struct Inner {
  double sigma_px = 1.5;
  Mode mode = Mode::kFixed;
  void Visit(OptionVisitor& v) {
    v.Value("sigma_px", sigma_px, "keypoint noise [px]", 0.0, 10.0);
    v.Choice("mode", mode, kModeNames, "what planes do");
  }
};

struct Outer {
  bool enabled = true;
  int levels = 8;
  std::string name = "orb";
  std::vector<std::string> classes = {"road", "wall"};
  std::vector<double> scales = {1.0, 1.5};
  Inner planes;
  void Visit(OptionVisitor& v) {
    v.Value("enabled", enabled, "whether it runs");
    v.Value("levels", levels, "pyramid levels", 1, 12);
    v.Value("name", name, "of the feature");
    v.Value("classes", classes, "planar classes");
    v.Value("scales", scales, "of the pyramid");
    v.Group("planes", planes, "plane terms");
  }
};

TEST(Options, JsonHasEveryFieldNested) {
  EXPECT_EQ(OptionsToJson(Outer()), json::parse(R"({"enabled": true, "levels": 8, "name": "orb",
                            "classes": ["road", "wall"], "scales": [1.0, 1.5],
                            "planes": {"sigma_px": 1.5, "mode": "fixed"}})"));
}

TEST(Options, JsonRoundTrip) {
  Outer options;
  options.enabled = false;
  options.levels = 3;
  options.name = "x y";
  options.classes = {};
  options.scales = {0.1, 1e-300};
  options.planes = {2.25, Mode::kOff};
  Outer read;
  OptionsFromJson(OptionsToJson(options), read, "test");
  EXPECT_EQ(OptionsToJson(read), OptionsToJson(options));
  EXPECT_EQ(read.planes.mode, Mode::kOff);
}

TEST(Options, WhatTheJsonLeavesOutStays) {
  Outer options;
  options.levels = 5;
  OptionsFromJson(json::parse(R"({"planes": {"mode": "off"}})"), options, "test");
  EXPECT_EQ(options.levels, 5);
  EXPECT_EQ(options.planes.mode, Mode::kOff);
  EXPECT_EQ(options.planes.sigma_px, 1.5);
}

TEST(Options, FaultsAreNamedAndChangeNothing) {
  const auto expect_error = [](const std::string& text, const std::string& message) {
    Outer options;
    EXPECT_THAT([&] { OptionsFromJson(json::parse(text), options, "my.json"); },
                ThrowsMessage<UsageError>(AllOf(HasSubstr("my.json"), HasSubstr(message))))
        << text;
    EXPECT_EQ(OptionsToJson(options), OptionsToJson(Outer()));
  };
  expect_error(R"({"enabled": false, "level": 3})", "'level', did you mean 'levels'?");
  expect_error(R"({"planes": {"sigma": 1}})", "'planes.sigma', did you mean 'planes.sigma_px'?");
  expect_error(R"({"sigma_px": 1})", "unknown key 'sigma_px'");
  expect_error(R"({"levels": 3.5})", "levels must be an integer");
  expect_error(R"({"levels": 5000000000})", "levels must be an integer");
  expect_error(R"({"levels": "3"})", "levels must be an integer");
  expect_error(R"({"levels": 13})", "levels = 13 is outside [1, 12]");
  expect_error(R"({"enabled": 1})", "enabled must be true or false");
  expect_error(R"({"name": null})", "name must be a string");
  expect_error(R"({"classes": ["a", 1]})", "classes must be a list of strings");
  expect_error(R"({"scales": 1.0})", "scales must be a list of numbers");
  expect_error(R"({"planes": {"sigma_px": -0.1}})", "planes.sigma_px");
  expect_error(R"({"planes": {"mode": "on"}})", "planes.mode must be one of off|fixed");
  expect_error(R"({"planes": 3})", "planes must be a JSON object");
  expect_error("[1]", "the document must be a JSON object");
}

TEST(Options, AssignmentsTakeJsonOrText) {
  Outer options;
  SetOption("levels=3", options);
  SetOption("planes.mode=off", options);
  SetOption("planes.sigma_px=2.5", options);
  SetOption("name=sift", options);
  SetOption("classes=[\"floor\"]", options);
  SetOption("enabled=false", options);
  EXPECT_EQ(options.levels, 3);
  EXPECT_EQ(options.planes.mode, Mode::kOff);
  EXPECT_EQ(options.planes.sigma_px, 2.5);
  EXPECT_EQ(options.name, "sift");
  EXPECT_THAT(options.classes, ::testing::ElementsAre("floor"));
  EXPECT_FALSE(options.enabled);
}

TEST(Options, FaultyAssignmentsAreRefused) {
  for (const char* text : {"levels", "=3", "levels=", "level=3", "planes.mode=on", "planes=3",
                           "planes..mode=off", "levels=99", "levels.x=1"}) {
    Outer options;
    EXPECT_THROW(SetOption(text, options), UsageError) << text;
    EXPECT_EQ(OptionsToJson(options), OptionsToJson(Outer())) << text;
  }
}

TEST(Options, CheckNamesTheFieldOutOfBounds) {
  Outer options;
  CheckOptions(options);
  options.planes.sigma_px = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT([&] { CheckOptions(options); },
              ThrowsMessage<UsageError>(HasSubstr("planes.sigma_px")));
  options = {};
  options.levels = 0;
  EXPECT_THAT([&] { CheckOptions(options); }, ThrowsMessage<UsageError>(HasSubstr("levels = 0")));
}

TEST(Options, DescriptionHasEveryFieldWithItsDefault) {
  const std::string text = DescribeOptions(Outer());
  for (const char* part : {"levels", "= 8", "pyramid levels", "planes.sigma_px", "1.5",
                           "keypoint noise [px]", "planes.mode", "fixed"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
}

TEST(NearestWord, IsTheOneWithTheSmallestEditDistance) {
  const std::vector<std::string> words = {"width", "height", "params"};
  EXPECT_EQ(NearestWord("hight", words), "height");
  EXPECT_EQ(NearestWord("widht", words), "width");
  EXPECT_EQ(NearestWord("param", words), "params");
  EXPECT_EQ(NearestWord("param", {}), "");
}

}  // namespace
}  // namespace s3lam
