#include "s3lam/io/panoptic_masks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/base/error.h"
#include "s3lam/io/semantic_map_io.h"
#include "support/captured_log.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using testing::FileBytes;
using ::testing::HasSubstr;
using testing::TempDir;

ClassTable Table() {
  ClassTable table{"test", {}};
  table.classes.push_back({7, "road", false, true, false, 50, SurfaceOrientation::kAny, {}});
  table.classes.push_back({13, "car", true, false, true, 50, SurfaceOrientation::kAny, {}});
  return table;
}

/// A PNG of 4 x 2 pixels of the given colours (R + 256 G + 65536 B), row by row.
std::string EncodeMask(const std::vector<uint32_t>& colours) {
  cv::Mat image(2, 4, CV_8UC3);
  for (int i = 0; i < 8; ++i) {
    const uint32_t c = colours.at(static_cast<size_t>(i));
    image.at<cv::Vec3b>(i / 4, i % 4) = {static_cast<uint8_t>(c >> 16),
                                         static_cast<uint8_t>(c >> 8 & 255),
                                         static_cast<uint8_t>(c & 255)};
  }
  std::vector<uint8_t> bytes;
  cv::imencode(".png", image, bytes);
  return {bytes.begin(), bytes.end()};
}

constexpr const char* kJson = R"({"annotations": [{"file_name": "a.png", "segments_info": [
    {"id": 70000, "category_id": 13, "iscrowd": 1, "score": 0.75},
    {"id": 5, "category_id": 7}]}]})";

/// The message of the InputError that `action` throws; empty if it throws none.
template <typename Action>
std::string ErrorOf(const Action& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

class CocoMasks : public ::testing::Test {
 protected:
  CocoMasks() { dir_.Write("masks/a.png", EncodeMask({5, 5, 70000, 70000, 0, 5, 70000, 0})); }

  [[nodiscard]] PanopticFrame Read(const std::string& json) const {
    dir_.Write("masks.json", json);
    return PanopticMasks(dir_ / "masks", MaskFormat::kAuto, {}, Table()).Read(0);
  }

  TempDir dir_;
};

TEST_F(CocoMasks, ReadsSegments) {
  const PanopticFrame frame = Read(kJson);
  SegmentImage expected(2, 4);
  expected << 5, 5, 70000, 70000, kNoSegment, 5, 70000, kNoSegment;
  EXPECT_EQ(frame.segment_ids, expected);
  ASSERT_EQ(frame.segments.size(), 2U);
  EXPECT_EQ(frame.segments.at(5).class_index, 0);
  EXPECT_DOUBLE_EQ(frame.segments.at(5).score, 1.0);
  EXPECT_FALSE(frame.segments.at(5).is_crowd);
  EXPECT_EQ(frame.segments.at(70000).class_index, 1);
  EXPECT_DOUBLE_EQ(frame.segments.at(70000).score, 0.75);
  EXPECT_TRUE(frame.segments.at(70000).is_crowd);
}

TEST_F(CocoMasks, FindsTheJson) {
  dir_.Write("masks/inside.json", kJson);
  EXPECT_EQ(PanopticMasks(dir_ / "masks", MaskFormat::kCoco, {}, Table()).Read(0).segments.size(),
            2U);
  dir_.Write("masks/other.json", kJson);
  EXPECT_THAT(ErrorOf([&] { PanopticMasks(dir_ / "masks", MaskFormat::kCoco, {}, Table()); }),
              HasSubstr("give --mask-json"));
  dir_.Write("elsewhere.json", kJson);
  EXPECT_EQ(PanopticMasks(dir_ / "masks", MaskFormat::kAuto, dir_ / "elsewhere.json", Table())
                .Read(0)
                .segments.size(),
            2U);
}

TEST_F(CocoMasks, NamesWhatIsWrongWithTheJson) {
  const auto error = [&](const std::string& segments) {
    return ErrorOf([&] {
      (void)Read(R"({"annotations": [{"file_name": "a.png", "segments_info": )" + segments + "}]}");
    });
  };
  EXPECT_THAT(error(R"([{"id": 5, "category_id": 7}])"),
              AllOf(HasSubstr("segment 70000 is not in the"), HasSubstr("with interpolation?")));
  EXPECT_THAT(error(R"([{"id": 5, "category_id": 8}])"), HasSubstr("class 8 is not in the class"));
  EXPECT_THAT(error(R"([{"id": 5, "category_id": 7}, {"id": 5, "category_id": 7}])"),
              HasSubstr("segment 5: is listed twice"));
  EXPECT_THAT(error(R"([{"category_id": 7}])"), HasSubstr("'id' is missing"));
  EXPECT_THAT(error(R"([{"id": 5}])"), HasSubstr("'category_id' is missing"));
  EXPECT_THAT(error(R"([{"id": 0, "category_id": 7}])"), HasSubstr("segment 0"));
  EXPECT_THAT(error(R"([{"id": 5, "category_id": 7, "score": -0.1}])"), HasSubstr("score -0.1"));
  EXPECT_THAT(error(R"([{"id": 5, "category_id": 7, "score": null}])"), HasSubstr("score null"));
  EXPECT_THAT(error(R"([{"id": 5, "category_id": 99999999999}])"), HasSubstr("99999999999"));
  EXPECT_THAT(error("3"), HasSubstr("'segments_info' is missing or not a list"));
  EXPECT_THAT(ErrorOf([&] { (void)Read("[]"); }), HasSubstr("no list 'annotations'"));
  EXPECT_THAT(ErrorOf([&] { (void)Read(R"({"annotations": [{}]})"); }), HasSubstr("'file_name'"));
  EXPECT_THAT(ErrorOf([&] { (void)Read(R"({"annotations": []})"); }), HasSubstr("no annotation"));
  EXPECT_THAT(ErrorOf([&] { (void)Read("{"); }), HasSubstr("masks.json: not valid JSON"));
}

TEST_F(CocoMasks, RefusesEveryTruncation) {
  const std::string whole = FileBytes(dir_ / "masks/a.png");
  for (size_t size = 0; size < whole.size(); ++size) {
    dir_.Write("masks/a.png", whole.substr(0, size));
    EXPECT_THAT(ErrorOf([&] { (void)Read(kJson); }), HasSubstr("a.png: ")) << size << " bytes";
  }
}

TEST_F(CocoMasks, RefusesDamagedAndForeignImages) {
  std::string damaged = FileBytes(dir_ / "masks/a.png");
  damaged[damaged.find("IDAT") + 6] ^= 0x40;
  dir_.Write("masks/a.png", damaged);
  EXPECT_THAT(ErrorOf([&] { (void)Read(kJson); }), HasSubstr("a.png: "));
  std::vector<uint8_t> bytes;
  cv::imencode(".png", cv::Mat(2, 4, CV_16UC1, cv::Scalar(5)), bytes);
  dir_.Write("masks/a.png", std::string(bytes.begin(), bytes.end()));
  EXPECT_THAT(ErrorOf([&] { (void)Read(kJson); }), HasSubstr("1 channel(s) of 16 bits"));
}

TEST(PanopticMasks, ReadsKittiStep) {
  const TempDir dir;
  const uint32_t car_300 = 13 | 1 << 8 | 44 << 16;  // Instance 256 * 1 + 44.
  dir.Write("000000.png", EncodeMask({7, 7, car_300, 13, 255, 255, 255 | 3 << 8, 7}));
  const PanopticMasks masks(dir.path(), MaskFormat::kAuto, {}, Table());
  EXPECT_EQ(masks.format(), MaskFormat::kKittiStep);
  const PanopticFrame frame = masks.Read(0);
  SegmentImage expected(2, 4);
  expected << 7, 7, car_300, 13, kNoSegment, kNoSegment, kNoSegment, 7;
  EXPECT_EQ(frame.segment_ids, expected);
  ASSERT_EQ(frame.segments.size(), 3U);
  EXPECT_EQ(frame.segments.at(7).class_index, 0);
  EXPECT_FALSE(frame.segments.at(7).is_crowd);
  EXPECT_EQ(frame.segments.at(car_300).class_index, 1);
  EXPECT_FALSE(frame.segments.at(car_300).is_crowd);
  EXPECT_TRUE(frame.segments.at(13).is_crowd);
}

TEST(PanopticMasks, RefusesUnknownKittiStepClass) {
  const TempDir dir;
  dir.Write("000000.png", EncodeMask({7, 7, 7, 99, 7, 7, 7, 7}));
  const PanopticMasks masks(dir.path(), MaskFormat::kKittiStep, {}, Table());
  EXPECT_THAT(ErrorOf([&] { (void)masks.Read(0); }), HasSubstr("class 99 is not in the class"));
}

TEST(PanopticMasks, RefusesFoldersWithoutMasks) {
  const TempDir dir;
  EXPECT_THAT(ErrorOf([&] { PanopticMasks(dir / "none", MaskFormat::kAuto, {}, Table()); }),
              HasSubstr("no such folder"));
  EXPECT_THAT(ErrorOf([&] { PanopticMasks(dir.path(), MaskFormat::kAuto, {}, Table()); }),
              HasSubstr("no masks in it"));
}

TEST(MatchMasksToImages, FollowsItsRules) {
  const auto match = [](const std::vector<std::string>& images,
                        const std::vector<std::string>& masks) {
    std::vector<int> result;
    for (const auto& m : MatchMasksToImages(images, masks)) {
      result.push_back(m ? static_cast<int>(*m) : -1);
    }
    return result;
  };
  EXPECT_THAT(match({"b/1.jpg", "a/1.jpg", "a/2.jpg"}, {"a/1.png", "b/1.png"}),
              ElementsAre(1, 0, -1));
  EXPECT_THAT(match({"f-0.color.jpg", "f-1.color.jpg"}, {"f-0.png", "f-1.png"}), ElementsAre(0, 1));
  EXPECT_THAT(match({"a/1.jpg"}, {"a/1.panoptic.png"}), ElementsAre(0));
  EXPECT_THAT(match({"cam0/1.jpg", "cam0/2.jpg"}, {"2.png", "1.png"}), ElementsAre(1, 0));
  EXPECT_THAT(match({"rgb/1.color.jpg"}, {"masks/1.png"}), ElementsAre(0));
  EXPECT_THAT(match({"1.jpg"}, {"masks/1.instance.png"}), ElementsAre(0));
  // The last folder tells cameras apart, wherever the images' root is.
  EXPECT_THAT(match({"images/a/1.jpg", "images/b/1.jpg"}, {"b/1.png", "a/1.png"}),
              ElementsAre(1, 0));
  // A mask in another camera's folder, or of another image, is not taken.
  EXPECT_THAT(match({"a/1.jpg", "b/1.jpg"}, {"a/1.png"}), ElementsAre(0, -1));
  EXPECT_THAT(match({"a/2.jpg", "b/1.jpg"}, {"a/1.png"}), ElementsAre(-1, -1));
  EXPECT_THAT(match({"c/a_leftImg8bit.png"}, {"c/a_gtFine_instanceIds.png"}), ElementsAre(0));
  EXPECT_THAT(match({"color/0.jpg"}, {"label-filt/0.png"}), ElementsAre(0));
  // The stronger rule wins.
  EXPECT_THAT(match({"a/1.jpg"}, {"1.png", "a/1.png"}), ElementsAre(1));
}

TEST(MatchMasksToImages, TakesNoMasksFromAFolderOfOtherImages) {
  const std::vector<std::string> images = {"phone/1.jpg", "phone/2.jpg"};
  const std::vector<std::string> masks = {"day2/1.png", "day2/2.png", "phone/1.png"};
  const auto matches = MatchMasksToImages(images, masks);
  EXPECT_EQ(matches[0], 2U);
  EXPECT_EQ(matches[1], std::nullopt);
  // The last folder alone tells as little.
  const auto deeper = MatchMasksToImages({"x/a/1.jpg", "x/a/2.jpg"}, {"x/a/1.png", "y/a/2.png"});
  EXPECT_EQ(deeper[1], std::nullopt);
  // Without any folder, or where none of the folders is the images', a name will do.
  EXPECT_EQ(MatchMasksToImages(images, {"2.png", "phone/1.png"})[1], 0U);
  EXPECT_EQ(MatchMasksToImages(images, {"day2/1.png", "day2/2.png"})[1], 1U);
  EXPECT_EQ(MatchMasksToImages({"1.jpg", "2.jpg"}, {"1.png", "more/2.png"})[1], 1U);
}

TEST(MatchMasksToImages, WarnsWhenOnlySomeAreFoundByPath) {
  const testing::CapturedLog log;
  MatchMasksToImages({"a/1.jpg", "a/2.jpg"}, {"a/1.png", "a/2.png"});
  MatchMasksToImages({"a/1.jpg", "a/2.jpg"}, {"1.png", "2.png"});
  EXPECT_EQ(log.text(), "");
  MatchMasksToImages({"a/1.jpg", "a/2.jpg", "a/3.jpg"}, {"a/1.png", "2.png", "3.png"});
  EXPECT_THAT(log.text(), HasSubstr("1 found by the paths"));
  EXPECT_THAT(log.text(), HasSubstr("2 by no more"));
  EXPECT_THAT(log.text(), HasSubstr("mask 2.png for image a/2.jpg"));
  const std::string text = log.text();
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1);
}

TEST(MatchMasksToImages, RefusesAmbiguity) {
  EXPECT_THAT(ErrorOf([] {
                MatchMasksToImages({"1.jpg"}, {"a/1.png", "b/1.png"});
              }),
              HasSubstr("both masks a/1.png and b/1.png"));
  EXPECT_THAT(ErrorOf([] {
                MatchMasksToImages({"a/1.jpg", "b/1.jpg"}, {"1.png"});
              }),
              HasSubstr("fits both images a/1.jpg and b/1.jpg"));
}

TEST(MaskFormat, HasNames) {
  for (const MaskFormat format :
       {MaskFormat::kAuto, MaskFormat::kCoco, MaskFormat::kKittiStep, MaskFormat::kProbabilities}) {
    EXPECT_EQ(MaskFormatFromName(MaskFormatName(format)), format);
  }
  EXPECT_FALSE(MaskFormatFromName("bmp").has_value());
}

}  // namespace
}  // namespace s3lam
