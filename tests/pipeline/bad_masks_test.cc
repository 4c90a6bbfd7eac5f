// What s3-lift says to masks and class tables that cannot be used.

#include <nlohmann/json.hpp>

#include "pipeline/model_fixture.h"
#include "s3lam/io/npy.h"

namespace s3lam {
namespace {

using nlohmann::json;
using testing::ExpectRefused;
using testing::kBadInput;
using testing::kClasses;
using testing::kDone;
using testing::RunProgramApart;
using testing::RunTool;
using testing::TempDir;

class BadMasks : public testing::ModelTest {
 protected:
  json LiftReport(std::vector<std::string> more_arguments = {}) {
    std::vector<std::string> arguments = LiftArguments();
    arguments.insert(arguments.end(), {"--output", output().string(), "--json"});
    arguments.insert(arguments.end(), more_arguments.begin(), more_arguments.end());
    const auto result = RunTool("s3-lift", arguments);
    EXPECT_EQ(result.exit_code, kDone) << result.errors;
    return json::parse(result.output);
  }

  /// Turns the masks into COCO panoptic ones with segment 7 everywhere.
  void WriteCocoMasks(int category_id) const {
    json annotations = json::array();
    for (const std::string& name : mask_names_) {
      WriteMask(name, mask_size_, 7);
      annotations.push_back(
          {{"file_name", name}, {"segments_info", {{{"id", 7}, {"category_id", category_id}}}}});
    }
    inputs_.Write("masks.json", json{{"annotations", annotations}}.dump());
  }

  void ExpectCocoRefused(const std::vector<std::string>& parts) {
    ExpectRefusedWithoutTrace("s3-lift",
                              {"--model", model().string(), "--masks", masks().string(),
                               "--classes", (kClasses / "coco.json").string()},
                              kBadInput, parts);
  }
};

TEST_F(BadMasks, MissingFolder) {
  std::filesystem::remove_all(masks());
  ExpectLiftRefused({masks().string()});
}

TEST_F(BadMasks, EmptyFolder) {
  for (const std::string& name : mask_names_) std::filesystem::remove(masks() / name);
  ExpectLiftRefused({masks().string()});
}

TEST_F(BadMasks, NoMaskFitsAnImage) {
  for (size_t i = 0; i < mask_names_.size(); ++i) {
    std::filesystem::rename(masks() / mask_names_[i],
                            masks() / ("other" + std::to_string(i) + ".png"));
  }
  ExpectLiftRefused({"mask"});
}

TEST_F(BadMasks, AnotherShape) {
  WriteMask(mask_names_[3], cv::Size(mask_size_.width, mask_size_.height / 2), kRoad);
  ExpectLiftRefused({mask_names_[3].substr(0, mask_names_[3].rfind('.')),
                     std::to_string(mask_size_.height), std::to_string(mask_size_.height / 2)});
}

TEST_F(BadMasks, AnotherShapeIsSkippedAndCountedWhenLenient) {
  WriteMask(mask_names_[3], cv::Size(mask_size_.width, mask_size_.height / 2), kRoad);
  const json report = LiftReport({"--lenient"});
  EXPECT_EQ(report["images_with_bad_mask"], 1);
  EXPECT_EQ(report["images_with_mask"], mask_names_.size() - 1);
}

TEST_F(BadMasks, HalfTheResolutionIsScaledAndCounted) {
  WriteMask(mask_names_[3], mask_size_ / 2, kRoad);
  const json report = LiftReport();
  EXPECT_EQ(report["scaled_masks"], 1);
  EXPECT_EQ(report["images_with_mask"], mask_names_.size());
}

TEST_F(BadMasks, MissingOneIsSkippedAndCounted) {
  std::filesystem::remove(masks() / mask_names_[2]);
  const json report = LiftReport();
  EXPECT_EQ(report["images_without_mask"], 1);
  EXPECT_EQ(report["images_with_mask"], mask_names_.size() - 1);
}

TEST_F(BadMasks, MasksOfOtherFramesAreToldOf) {
  const auto lift = [&] {
    std::vector<std::string> arguments = LiftArguments();
    arguments.insert(arguments.end(), {"--output", output().string(), "--overwrite"});
    return RunTool("s3-lift", arguments).errors;
  };
  const auto rename_to_other = [&](size_t i) {
    std::filesystem::rename(masks() / mask_names_[i],
                            masks() / ("other" + std::to_string(i) + ".png"));
  };
  ASSERT_EQ(mask_names_.size(), 8U);
  for (size_t i = 0; i < 4; ++i) rename_to_other(i);
  EXPECT_EQ(lift(), "");  // Half of the images have one.
  rename_to_other(4);
  EXPECT_THAT(lift(), ::testing::HasSubstr("5 of the model's 8 images have no mask, and 5 of 8 "
                                           "masks belong to no image"));
  const json unmasked =
      json::parse(testing::FileBytes(output() / "report.json"))["images_unmasked"];
  ASSERT_EQ(unmasked.size(), 5U);
  EXPECT_EQ(std::filesystem::path(unmasked[0]).stem(),
            std::filesystem::path(mask_names_[0]).stem());
  // Masks that are merely missing are counted, as always.
  for (size_t i = 0; i < 5; ++i) {
    std::filesystem::remove(masks() / ("other" + std::to_string(i) + ".png"));
  }
  EXPECT_EQ(lift(), "");
}

TEST_F(BadMasks, CutShort) {
  Truncate(masks() / mask_names_[4], 0.5);
  ExpectLiftRefused({(masks() / mask_names_[4]).string()});
}

TEST_F(BadMasks, UnknownClassInTheImage) {
  WriteMask(mask_names_[1], mask_size_, 99);
  ExpectLiftRefused({(masks() / mask_names_[1]).string(), "99"});
}

TEST_F(BadMasks, UnknownClassInTheJson) {
  WriteCocoMasks(4242);
  ExpectCocoRefused({"masks.json", "4242"});
}

TEST_F(BadMasks, StuffWhoseNumberIsThatOfAThing) {
  constexpr int kCar = 13;
  const auto write = [&](size_t i, int category_id, bool is_thing) {
    const json info = {{"id", 7}, {"category_id", category_id}, {"isthing", is_thing}};
    cv::imwrite((masks() / mask_names_[i]).string(), cv::Mat(mask_size_, CV_8UC1, cv::Scalar(7)));
    inputs_.Write("masks/" + std::filesystem::path(mask_names_[i]).stem().string() + ".json",
                  json{{"segments_info", {info}}}.dump());
  };
  for (size_t i = 0; i < mask_names_.size(); ++i) write(i, kRoad, false);
  EXPECT_EQ(LiftReport()["images_with_mask"], mask_names_.size());
  std::filesystem::remove_all(output());
  write(2, kCar, false);
  ExpectLiftRefused({"isthing is false", "(car), which is a thing"});
  EXPECT_EQ(LiftReport({"--lenient"})["images_with_bad_mask"], 1);
}

TEST_F(BadMasks, SegmentThatTheJsonDoesNotList) {
  WriteCocoMasks(67);
  WriteMask(mask_names_[5], mask_size_, 8);
  ExpectCocoRefused({mask_names_[5], "8"});
}

TEST_F(BadMasks, MalformedJson) {
  WriteCocoMasks(67);
  Truncate(inputs_ / "masks.json", 0.9);
  ExpectCocoRefused({"masks.json"});
}

TEST_F(BadMasks, JsonOfSomethingElse) {
  inputs_.Write("masks.json", R"({"images": [1, 2, 3]})");
  ExpectCocoRefused({"masks.json", "annotations"});
}

TEST_F(BadMasks, MalformedClassTable) {
  const auto table = inputs_.Write("classes.json", R"({"classes": [{"id": 1}]})");
  ExpectRefusedWithoutTrace(
      "s3-lift",
      {"--model", model().string(), "--masks", masks().string(), "--classes", table.string()},
      kBadInput, {table.string()});
}

TEST_F(BadMasks, MissingClassTable) {
  ExpectRefusedWithoutTrace("s3-lift",
                            {"--model", model().string(), "--masks", masks().string(), "--classes",
                             "/nonexistent/classes.json"},
                            kBadInput, {"/nonexistent/classes.json"});
}

TEST_F(BadMasks, ClassTableOfAnUnknownName) {
  ExpectRefusedWithoutTrace(
      "s3-lift", {"--model", model().string(), "--masks", masks().string(), "--classes", "cooc"},
      kBadInput, {"cooc: no such file", "configs/classes", "did you mean 'coco'?", "cityscapes"});
}

TEST_F(BadMasks, ClassTableByNameWhereNoneIsBesideTheProgram) {
  const TempDir elsewhere;
  std::filesystem::create_directories(elsewhere / "build" / "bin");
  const auto program = elsewhere / "build" / "bin" / "s3-lift";
  std::filesystem::copy_file(std::filesystem::path(S3LAM_TEST_BIN_DIR) / "s3-lift", program);
  const auto result =
      RunProgramApart({program.string(), "--quiet", "--model", model().string(), "--masks",
                       masks().string(), "--classes", "coco", "--output", output().string()});
  ExpectRefused(result, kBadInput,
                {"coco: no such file", (elsewhere / "build/share/s3lam/configs").string(),
                 (elsewhere / "configs").string(), "give a path"});
}

TEST_F(BadMasks, LenientSkipsAndCountsInEveryFormat) {
  for (const std::string& name : mask_names_) {
    cv::imwrite((masks() / name).string(), cv::Mat(mask_size_, CV_8UC1, cv::Scalar(kRoad)));
  }
  cv::imwrite((masks() / mask_names_[2]).string(), cv::Mat(mask_size_, CV_8UC1, cv::Scalar(77)));
  ExpectLiftRefused({mask_names_[2], "77"});
  EXPECT_EQ(LiftReport({"--lenient"})["images_with_bad_mask"], 1);
}

TEST_F(BadMasks, LabelMapThatIsNone) {
  std::vector<std::string> arguments = LiftArguments();
  const auto map = inputs_.Write("map.json", R"({"0": "road"})");
  arguments.insert(arguments.end(), {"--label-map", map.string()});
  ExpectRefusedWithoutTrace("s3-lift", arguments, kBadInput, {map.string(), "road"});
}

TEST_F(BadMasks, ConfusionOfAnotherSize) {
  std::vector<std::string> arguments = LiftArguments();
  const auto matrix = inputs_ / "confusion.npy";
  WriteNpy(MatrixXfRow::Identity(3, 3), matrix);
  arguments.insert(arguments.end(), {"--confusion", matrix.string()});
  ExpectRefusedWithoutTrace("s3-lift", arguments, kBadInput, {matrix.string(), "3 x 3"});
}

}  // namespace
}  // namespace s3lam
