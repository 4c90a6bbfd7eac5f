// What s3-lift writes besides the semantic map.

#include <fmt/format.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "pipeline/model_fixture.h"

namespace s3lam {
namespace {

using nlohmann::json;
using testing::ExpectRefused;
using testing::FileBytes;
using testing::kBadInput;
using testing::kClasses;
using testing::kDone;
using testing::kWrongUsage;
using testing::Listing;
using testing::ProgramResult;
using testing::RunTool;

class LiftFeatures : public testing::ModelTest {
 protected:
  static constexpr int kCar = 13;

  /// Writes a grey image for every mask, under the names of the model's images.
  void WriteImages() const {
    std::filesystem::create_directories(images());
    for (const auto& [id, image] : ReadColmapModel(model()).images) {
      cv::imwrite((images() / image.name).string(), cv::Mat(mask_size_, CV_8UC1, cv::Scalar(90)));
    }
  }

  [[nodiscard]] std::filesystem::path images() const { return inputs_ / "images"; }

  [[nodiscard]] ProgramResult Lift(const std::vector<std::string>& more) const {
    std::vector<std::string> arguments = LiftArguments();
    arguments.insert(arguments.end(), {"--output", output().string()});
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunTool("s3-lift", arguments);
  }

  /// Arguments that write what to ignore in the images.
  [[nodiscard]] std::vector<std::string> IgnoreArguments() const {
    return {"--sequence",     images().string(), "--masks",
            masks().string(), "--classes",       (kClasses / "cityscapes.json").string(),
            "--output",       output().string(), "--overwrite",
            "--json"};
  }

  [[nodiscard]] ProgramResult Ignore(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = IgnoreArguments();
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunTool("s3-lift", arguments);
  }

  [[nodiscard]] std::vector<std::string> IgnoreMasks() const {
    std::vector<std::string> names = Listing(output());
    std::erase_if(names, [](const std::string& name) { return !name.ends_with(".png"); });
    return names;
  }
};

TEST_F(LiftFeatures, OverlaysOfSoManyImages) {
  WriteImages();
  const ProgramResult result = Lift({"--overlays", "3", "--images", images().string()});
  ASSERT_EQ(result.exit_code, kDone) << result.errors;
  const auto names = Listing(output() / "overlays");
  ASSERT_EQ(names.size(), 3U);
  const cv::Mat picture = cv::imread((output() / "overlays" / names.front()).string());
  EXPECT_EQ(picture.size(), mask_size_);
  EXPECT_GT(cv::norm(picture, cv::Mat(picture.size(), CV_8UC3, cv::Scalar::all(90)), cv::NORM_INF),
            50.0);  // Something is drawn.
}

TEST_F(LiftFeatures, OverlaysFindTheImagesByTheProject) {
  WriteImages();
  ExpectRefused(Lift({"--overlays", "1"}), kWrongUsage, {"--images"});
  WriteColmapProject(images(), model() / "project.ini");
  ASSERT_EQ(Lift({"--overlays", "1"}).exit_code, kDone);
  EXPECT_EQ(Listing(output() / "overlays").size(), 1U);
}

TEST_F(LiftFeatures, OverlaysMissAnImageBeforeAnythingIsComputed) {
  WriteImages();
  const std::string name = ReadColmapModel(model()).images.begin()->second.name;
  std::filesystem::remove(images() / name);
  Truncate(masks() / mask_names_[1], 0.5);  // Never read.
  ExpectRefused(Lift({"--overlays", "all", "--images", images().string()}), kBadInput,
                {(images() / name).string(), "--images"});
  EXPECT_FALSE(std::filesystem::exists(output()));
}

TEST_F(LiftFeatures, OverlaysFindImagesThatTheProjectNamesFromTheModel) {
  WriteImages();
  inputs_.Write("model/project.ini", "image_path=../images\n");
  const ProgramResult result = Lift({"--overlays", "1"});
  ASSERT_EQ(result.exit_code, kDone) << result.errors;
  EXPECT_EQ(Listing(output() / "overlays").size(), 1U);
}

TEST_F(LiftFeatures, OverlaysThatCannotBeDrawn) {
  WriteImages();
  ExpectRefused(Lift({"--overlays", "nobody.png", "--images", images().string()}), kBadInput,
                {"nobody.png"});
  ExpectRefused(Lift({"--overlays", "all", "--images", "/nonexistent"}), kBadInput,
                {"/nonexistent"});
  EXPECT_FALSE(std::filesystem::exists(output()));
}

TEST_F(LiftFeatures, IgnoreMasksOfASequence) {
  WriteImages();
  cv::Mat mask(mask_size_, CV_8UC3, cv::Scalar(0, 0, kRoad));
  const cv::Rect car(100, 100, 60, 40);
  mask(car) = cv::Scalar(1, 0, kCar);  // Instance 1 in blue, the label in red.
  cv::imwrite((masks() / mask_names_[0]).string(), mask);
  const ProgramResult result = Ignore({"--ignore-margin", "0"});
  ASSERT_EQ(result.exit_code, kDone) << result.errors;
  EXPECT_EQ(json::parse(result.output)["frames_with_mask"], mask_names_.size());
  const auto names = IgnoreMasks();
  ASSERT_EQ(names.size(), mask_names_.size());
  const cv::Mat ignored = cv::imread((output() / names[0]).string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(ignored.size(), mask_size_);
  EXPECT_EQ(static_cast<int>(ignored.total()) - cv::countNonZero(ignored), car.area());
  EXPECT_EQ(ignored.at<uint8_t>(car.y + 5, car.x + 5), 0);
  const cv::Mat other = cv::imread((output() / names[1]).string(), cv::IMREAD_UNCHANGED);
  EXPECT_EQ(cv::countNonZero(other), static_cast<int>(other.total()));
}

TEST_F(LiftFeatures, IgnoreMasksOfAnotherShapeAreRefused) {
  WriteImages();
  const auto write_camera = [&](int height) {
    inputs_.Write("images/camera.json",
                  fmt::format(R"({{"model": "PINHOLE", "width": {}, "height": {},
                                   "params": [500, 500, 320, 240]}})",
                              2 * mask_size_.width, height));
  };
  write_camera(2 * mask_size_.height);
  EXPECT_EQ(Ignore().exit_code, kDone);
  write_camera(3 * mask_size_.height);
  ExpectRefused(Ignore(), kBadInput, {"the mask is"});
}

TEST_F(LiftFeatures, IgnoreMasksOfAnotherShapeThanImagesWithoutACameraAreRefused) {
  WriteImages();
  WriteMask(mask_names_[1], mask_size_ / 2, kRoad);
  const ProgramResult scaled = Ignore();
  ASSERT_EQ(scaled.exit_code, kDone) << scaled.errors;
  EXPECT_EQ(json::parse(scaled.output)["scaled_masks"], 1);
  for (const std::string& name : IgnoreMasks()) {
    EXPECT_EQ(cv::imread((output() / name).string()).size(), mask_size_) << name;
  }
  WriteMask(mask_names_[1], {mask_size_.width, mask_size_.height / 2}, kRoad);
  ExpectRefused(Ignore(), kBadInput, {"the mask is"});
}

TEST_F(LiftFeatures, IgnoreMasksThatCannotBeMadeAreSkippedAndCountedWhenLenient) {
  WriteImages();
  WriteMask(mask_names_[1], {mask_size_.width, mask_size_.height / 2}, kRoad);
  Truncate(masks() / mask_names_[2], 0.5);
  std::filesystem::remove(masks() / mask_names_[3]);
  const std::vector<std::vector<std::string>> ways = {{"--lenient"},
                                                      {"--set", "lookup.lenient=true"}};
  for (const std::vector<std::string>& lenient : ways) {
    const ProgramResult result = Ignore(lenient);
    ASSERT_EQ(result.exit_code, kDone) << result.errors;
    const json report = json::parse(result.output);
    EXPECT_EQ(report["frames"], mask_names_.size());
    EXPECT_EQ(report["frames_with_mask"], mask_names_.size() - 3);
    EXPECT_EQ(report["frames_with_bad_mask"], 2);
    EXPECT_EQ(report["frames_without_mask"], 1);
    EXPECT_EQ(IgnoreMasks().size(), mask_names_.size() - 3);
  }
  for (const std::string& name : mask_names_) WriteMask(name, mask_size_, 99);
  ExpectRefused(Ignore({"--lenient"}), kBadInput,
                {fmt::format("all {} masks", mask_names_.size()), "unusable"});
}

TEST_F(LiftFeatures, IgnoreMasksComeWithReportAndConfiguration) {
  WriteImages();
  ASSERT_EQ(Ignore({"--lenient", "--ignore-margin", "2"}).exit_code, kDone);
  const json report = json::parse(FileBytes(output() / "report.json"));
  EXPECT_EQ(report["program"], "s3-lift");
  EXPECT_EQ(report["ignore_margin_px"], 2);
  EXPECT_EQ(report["inputs"]["masks"]["files"], mask_names_.size());
  EXPECT_TRUE(report["inputs"].contains("classes"));
  EXPECT_TRUE(report["inputs"].contains("frames"));
  const json config = json::parse(FileBytes(output() / "config.json"));
  EXPECT_EQ(config, report["config"]);
  EXPECT_EQ(config["lookup"]["lenient"], true);
  // It can be read back, as can that of the whole stage.
  const auto saved = inputs_.Write("c.json", config.dump());
  EXPECT_EQ(Ignore({"--config", saved.string()}).exit_code, kDone);
  EXPECT_EQ(json::parse(FileBytes(output() / "config.json")), config);
  const auto all = std::filesystem::path(S3LAM_TEST_SOURCE_DIR) / "configs" / "lift.json";
  EXPECT_EQ(Ignore({"--config", all.string()}).exit_code, kDone);
}

TEST_F(LiftFeatures, IgnoreMasksRefuseWhatTheyCannotHonour) {
  WriteImages();
  ExpectRefused(Ignore({"--set", "lookup.border_px=3"}), kWrongUsage,
                {"lookup.border_px", "--sequence"});
  ExpectRefused(Ignore({"--set", "lookup.border=3"}), kWrongUsage, {"lookup.border_px"});
  ExpectRefused(Ignore({"--overlays", "all"}), kWrongUsage, {"--overlays"});
  ExpectRefused(Ignore({"--images", images().string()}), kWrongUsage, {"--images"});
  ExpectRefused(Ignore({"--confusion", "c.npy"}), kWrongUsage, {"--confusion"});
}

TEST_F(LiftFeatures, IgnoreMasksGrowByTheMargin) {
  WriteImages();
  cv::Mat mask(mask_size_, CV_8UC3, cv::Scalar(0, 0, kRoad));
  mask.at<cv::Vec3b>(50, 60) = {1, 0, kCar};
  cv::imwrite((masks() / mask_names_[0]).string(), mask);
  ASSERT_EQ(Ignore({"--ignore-margin", "4"}).exit_code, kDone);
  const cv::Mat ignored = cv::imread((output() / IgnoreMasks()[0]).string(), cv::IMREAD_UNCHANGED);
  EXPECT_EQ(ignored.at<uint8_t>(50, 64), 0);
  EXPECT_NE(ignored.at<uint8_t>(50, 65), 0);
}

TEST_F(LiftFeatures, IgnoreMasksOfAVideoGoByTheNamesOfItsFrames) {
  for (size_t i = 0; i < mask_names_.size(); ++i) {
    std::filesystem::rename(masks() / mask_names_[i],
                            masks() / fmt::format("clip_{:06d}.png", 3 * i));
  }
  for (const char* other : {"clip_notes.png", "clip_3.png", "clip_0000003.png", "clip_000004a.png",
                            "clip_-00001.png", "clip_.png"}) {
    std::filesystem::copy_file(masks() / "clip_000003.png", masks() / other);
  }
  std::filesystem::rename(masks() / "clip_000006.png", masks() / "clip_000006.panoptic.png");
  std::vector<std::string> arguments = IgnoreArguments();
  std::string& sequence = arguments[1];
  sequence = (inputs_ / "clip.mp4").string();
  std::ofstream(sequence) << "never decoded";
  const ProgramResult result = RunTool("s3-lift", arguments);
  ASSERT_EQ(result.exit_code, kDone) << result.errors;
  const auto names = IgnoreMasks();
  ASSERT_EQ(names.size(), mask_names_.size());
  EXPECT_EQ(names[1], "clip_000003.png.png");
  EXPECT_EQ(names[2], "clip_000006.png.png");
  sequence = (inputs_ / "other.mp4").string();
  std::ofstream(sequence) << "never decoded";
  ExpectRefused(RunTool("s3-lift", arguments), kBadInput, {"other.mp4", "other_000000.png"});
}

TEST_F(LiftFeatures, IgnoreMasksAndAModelExcludeEachOther) {
  WriteImages();
  ExpectRefused(Lift({"--sequence", images().string()}), kWrongUsage, {"--sequence", "--model"});
  ExpectRefused(Ignore({"--ignore-margin", "-1"}), kWrongUsage, {"--ignore-margin"});
  ExpectRefused(Lift({"--ignore-margin", "5"}), kWrongUsage, {"--ignore-margin", "--sequence"});
}

}  // namespace
}  // namespace s3lam
