// All stages on the real sequences: floors that no change may fall below.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "support/run_program.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using nlohmann::json;
using testing::RunProgramApart;
using testing::TempDir;

class RealStages : public ::testing::Test {
 protected:
  void SetUp() override {
    if (std::string(S3LAM_TEST_DATA_DIR).empty()) {
      GTEST_SKIP() << "no folder with real sequences given";
    }
  }

  [[nodiscard]] static std::string Data(const std::string& name) {
    return std::string(S3LAM_TEST_DATA_DIR) + "/" + name;
  }
  [[nodiscard]] std::string Output(const std::string& name) const {
    return (outputs_ / name).string();
  }

  /// Runs a program that must succeed; its report.
  static json Run(const std::string& tool, const std::vector<std::string>& arguments) {
    std::vector<std::string> words = {std::string(S3LAM_TEST_BIN_DIR) + "/" + tool, "--quiet",
                                      "--json"};
    words.insert(words.end(), arguments.begin(), arguments.end());
    const auto result = RunProgramApart(words);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return json::parse(result.output);
  }

  [[nodiscard]] json Slam(const std::string& sequence,
                          const std::vector<std::string>& settings = {}) const {
    std::vector<std::string> arguments = {"--sequence", Data(sequence), "--output", Output("slam")};
    arguments.insert(arguments.end(), settings.begin(), settings.end());
    return Run("s3-slam", arguments);
  }

  /// Lifts masks onto the SLAM's model and refines it with the planes found, and once without.
  json LiftAndRefine(const std::string& masks, const std::string& classes) {
    Run("s3-lift", {"--model", Output("slam"), "--masks", Data(masks), "--classes",
                    std::string(S3LAM_TEST_SOURCE_DIR) + "/configs/classes/" + classes, "--output",
                    Output("lift"), "--overwrite"});
    Run("s3-refine", {"--model", Output("slam"), "--output", Output("plain"), "--overwrite",
                      "--set", "planes.mode=off"});
    return Run("s3-refine", {"--model", Output("slam"), "--semantics", Output("lift"), "--output",
                             Output("planar"), "--overwrite"});
  }

  /// Absolute trajectory error of all frames [m], RMSE after Sim(3).
  [[nodiscard]] double Ate(const std::string& result, const std::string& reference) const {
    const json report = Run("s3-eval", {"--estimate", Output(result) + "/frames.txt",
                                        "--ground-truth", Data(reference)});
    return report["trajectory"]["ate"]["translation"]["rmse"];
  }

  void ExpectPlanesHelp(const json& report, const std::string& reference) const {
    ASSERT_EQ(report["arms"].size(), 3u);
    EXPECT_LT(report["arms"][2]["plane_rms"], report["arms"][1]["plane_rms"]);
    EXPECT_LT(Ate("planar", reference), 1.02 * Ate("plain", reference));
  }

 private:
  TempDir outputs_;
};

TEST_F(RealStages, Redkitchen) {
  const json report = Slam("redkitchen");
  EXPECT_EQ(report["frames"], 1000);
  EXPECT_GE(report["frames_localized"], 950);
  EXPECT_LE(Ate("slam", "redkitchen/groundtruth.txt"), 0.06);
  for (const std::string masks : {"clean", "noisy"}) {
    SCOPED_TRACE(masks);
    ExpectPlanesHelp(LiftAndRefine("redkitchen/panoptic_" + masks, "coco.json"),
                     "redkitchen/trajectory_colour_sfm.txt");
    EXPECT_LE(Ate("planar", "redkitchen/groundtruth.txt"), 0.06);
  }
}

TEST_F(RealStages, Kitti07) {
  const json report = Slam("kitti07");
  EXPECT_EQ(report["frames"], 160);
  EXPECT_GE(report["frames_localized"], 155);
  EXPECT_LE(Ate("slam", "kitti07/groundtruth.txt"), 0.45);
  for (const std::string masks : {"panoptic", "panoptic_noisy"}) {
    SCOPED_TRACE(masks);
    ExpectPlanesHelp(LiftAndRefine("kitti07/" + masks, "cityscapes.json"),
                     "kitti07/groundtruth.txt");
  }
}

TEST_F(RealStages, AMapFromABadStartIsMappedAgainFromElsewhere) {
  // In the middle half of the images, with 34 degrees of view, there are starts that bend the map.
  const std::filesystem::path original = Data("kitti07");
  const std::filesystem::path copy = Output("sequence");
  std::filesystem::create_directories(copy / "image_0");
  std::filesystem::copy_file(original / "times.txt", copy / "times.txt");
  cv::Rect middle;
  for (const auto& entry : std::filesystem::directory_iterator(original / "image_0")) {
    const cv::Mat image = cv::imread(entry.path().string(), cv::IMREAD_GRAYSCALE);
    middle = {image.cols / 4, image.rows / 4, image.cols / 2, image.rows / 2};
    ASSERT_TRUE(cv::imwrite((copy / "image_0" / entry.path().filename()).string(), image(middle),
                            {cv::IMWRITE_JPEG_QUALITY, 97}));
  }
  std::ifstream preset(std::string(S3LAM_TEST_SOURCE_DIR) + "/configs/cameras/kitti_04-12.json");
  json camera = json::parse(preset);
  camera["width"] = middle.width;
  camera["height"] = middle.height;
  camera["params"][2] = camera["params"][2].get<double>() - middle.x;
  camera["params"][3] = camera["params"][3].get<double>() - middle.y;
  std::ofstream(Output("camera.json")) << camera;
  const json report = Run("s3-slam", {"--sequence", copy.string(), "--camera",
                                      Output("camera.json"), "--output", Output("slam")});
  const json& again = report["mapped_again"];
  EXPECT_GE(again["attempts"], 1);
  EXPECT_GT(again["doubt_before"], 0.05);
  EXPECT_LE(again["doubt"], 0.05);
  EXPECT_LE(Ate("slam", "kitti07/groundtruth.txt"), 0.3);
}

TEST_F(RealStages, Mh05) {
  const json report = Slam("mh05");
  EXPECT_EQ(report["frames"], 585);
  EXPECT_GE(report["frames_localized"], 520);
  EXPECT_LE(Ate("slam", "mh05/groundtruth.txt"), 0.08);
}

TEST_F(RealStages, StartsOnAFastStraightDrive) {
  const json slam = Slam("kitti07", {"--frames", "60:85"});
  EXPECT_EQ(slam["frames_localized"], 25);
  EXPECT_LT(Ate("slam", "kitti07/groundtruth.txt"), 0.05);  // Of 20 m.
}

}  // namespace
}  // namespace s3lam
