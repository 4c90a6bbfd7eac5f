// One test or more per format of masks; those of COCO and KITTI-STEP are in panoptic_masks_test.cc.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <string>
#include <vector>

#include "s3lam/base/error.h"
#include "s3lam/io/panoptic_masks.h"
#include "s3lam/io/semantic_map_io.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using testing::FileBytes;
using ::testing::HasSubstr;
using testing::TempDir;

constexpr uint32_t kVoid = kNoSegment;

constexpr const char* kPalettePng =
    "89504e470d0a1a0a0000000d4948445200000002000000010803000000c3fc8fb8000000c0504c544500ff0004"
    "fe0108fd020cfc0310fb0414fa0518f9061cf80720f70824f60928f50a2cf40b30f30c34f20d38f10e3cf00f40"
    "ef1044ee1148ed124cec1350eb1454ea1558e9165ce81760e71864e61968e51a6ce41b70e31c74e21d78e11e7c"
    "e01f80df2084de2188dd228cdc2390db2494da2598d9269cd827a0d728a4d629a8d52aacd42bb0d32cb4d22db8"
    "d12ebcd02fc0cf30c4ce31c8cd32cccc33d0cb34d4ca35d8c936dcc837e0c738e4c639e8c53aecc43bf0c33cf4"
    "c23df8c13efcc03f516f108f0000000b49444154789c6360970200002b0022c085f9150000000049454e44ae42"
    "6082";
constexpr const char* kCompressedNpz =
    "504b030414000000080000002100cf8996675000000086000000090014006172725f302e6e7079010010008600"
    "00000000000050000000000000009bec17ea1b10c9c850c650ad9e925a9c5ca46ea5a05e536aa8aea3a09e965f"
    "54529498179f5f94920a12774bcc294e058a17672416a402f91a463a0a863a0ac69a3a0ab50ae401aeffc60c0c"
    "67fe0300504b0102140314000000080000002100cf899667500000008600000009000000000000000000000080"
    "01000000006172725f302e6e7079504b05060000000001000100370000008b0000000000";

ClassTable Table() {
  ClassTable table{"test", {}};
  table.classes.push_back({7, "road", false, true, false, 50, SurfaceOrientation::kAny, {}});
  table.classes.push_back({26, "car", true, false, true, 50, SurfaceOrientation::kAny, {}});
  return table;
}

/// One row of pixels as a gray PNG.
template <typename Pixel>
std::string GrayPng(std::vector<Pixel> row) {
  const int type = sizeof(Pixel) == 1 ? CV_8UC1 : CV_16UC1;
  std::vector<uint8_t> bytes;
  cv::imencode(".png", cv::Mat(1, static_cast<int>(row.size()), type, row.data()), bytes);
  return {bytes.begin(), bytes.end()};
}
std::string Png8(const std::vector<uint8_t>& row) { return GrayPng(row); }
std::string Png16(const std::vector<uint16_t>& row) { return GrayPng(row); }

/// A .npy of the given type and shape ("2, 1, 3").
template <typename Item>
std::string Npy(const std::string& type, const std::string& shape, const std::vector<Item>& items) {
  std::string header =
      "{'descr': '" + type + "', 'fortran_order': False, 'shape': (" + shape + "), }\n";
  std::string bytes("\x93NUMPY\x01\0", 8);
  bytes.push_back(static_cast<char>(header.size()));
  bytes.push_back('\0');
  bytes += header;
  const size_t begin = bytes.size();
  bytes.resize(begin + items.size() * sizeof(Item));
  std::memcpy(bytes.data() + begin, items.data(), items.size() * sizeof(Item));
  return bytes;
}

std::string FromHex(const std::string& hex) {
  std::string bytes;
  for (size_t i = 0; i < hex.size(); i += 2) {
    bytes.push_back(static_cast<char>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

template <typename Action>
std::string ErrorOf(const Action& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

class MaskFormats : public ::testing::Test {
 protected:
  [[nodiscard]] PanopticFrame Read(MaskFormat expected, const LabelMap& map = {},
                                   MaskFormat format = MaskFormat::kAuto) const {
    const PanopticMasks masks(dir_.path(), format, {}, Table(), map);
    EXPECT_EQ(MaskFormatName(masks.format()), MaskFormatName(expected));
    return masks.Read(0);
  }
  [[nodiscard]] std::string ReadError(MaskFormat format, const LabelMap& map = {}) const {
    return ErrorOf([&] { (void)PanopticMasks(dir_.path(), format, {}, Table(), map).Read(0); });
  }
  static std::vector<uint32_t> Row(const PanopticFrame& frame) {
    return {frame.segment_ids.data(), frame.segment_ids.data() + frame.segment_ids.size()};
  }

  TempDir dir_;
};
using Ids = std::vector<uint32_t>;

TEST_F(MaskFormats, Cityscapes) {
  dir_.Write("a/b_gtFine_instanceIds.png", Png16({7, 26000, 26001, 26, 7, 65535}));
  dir_.Write("a/b_gtFine_color.png", "ignored");
  dir_.Write("a/b_gtFine_polygons.json", "ignored");
  const PanopticFrame frame = Read(MaskFormat::kCityscapes);
  EXPECT_EQ(Row(frame), (Ids{7, 26000, 26001, 26, 7, kVoid}));
  EXPECT_EQ(frame.segments.at(7).class_index, 0);
  EXPECT_EQ(frame.segments.at(26001).class_index, 1);
  EXPECT_FALSE(frame.segments.at(26001).is_crowd);
  EXPECT_TRUE(frame.segments.at(26).is_crowd);
}

TEST_F(MaskFormats, CityscapesRefusesEightBitsAndUnknownLabels) {
  dir_.Write("b_instanceIds.png", Png8({7, 7}));
  EXPECT_THAT(ReadError(MaskFormat::kCityscapes),
              HasSubstr("8 bits a pixel where ids as class x 1000 + instance need 16"));
  dir_.Write("b_instanceIds.png", Png16({7, 27001}));
  EXPECT_THAT(ReadError(MaskFormat::kCityscapes), HasSubstr("class 27 is not in the class table"));
}

TEST_F(MaskFormats, LabelMapTranslatesAndMakesVoid) {
  dir_.Write("b_instanceIds.png", Png16({1, 2002, 3, 2002}));
  LabelMap map{"map.json", {{1, 7}, {2, 26}, {3, std::nullopt}}};
  const PanopticFrame frame = Read(MaskFormat::kCityscapes, map);
  EXPECT_EQ(Row(frame), (Ids{1, 2002, kVoid, 2002}));
  EXPECT_EQ(frame.segments.at(2002).class_index, 1);
  map.class_of_label.erase(3);
  EXPECT_THAT(ReadError(MaskFormat::kCityscapes, map),
              HasSubstr("label 3 is not in the label map"));
  map.class_of_label[3] = 8;
  EXPECT_THAT(ReadError(MaskFormat::kCityscapes, map), HasSubstr("class 8 is not in the class"));
}

TEST_F(MaskFormats, LabelDivisor) {
  dir_.Write("a.npy", Npy<int32_t>("<i4", "1, 4", {7000, 26003, -1, 26004}));
  const PanopticFrame frame = Read(MaskFormat::kLabelDivisor, {}, MaskFormat::kLabelDivisor);
  EXPECT_EQ(Row(frame), (Ids{7000, 26003, kVoid, 26004}));
  EXPECT_EQ(frame.segments.at(26004).class_index, 1);
}

TEST_F(MaskFormats, ScanNet) {
  dir_.Write("label-filt/0.png", Png16({7, 26, 26, 26, 0}));
  dir_.Write("instance-filt/0.png", Png8({1, 2, 3, 0, 0}));
  const PanopticFrame frame = Read(MaskFormat::kScanNet);
  EXPECT_EQ(Row(frame), (Ids{1, 2, 3, 4, kVoid}));
  EXPECT_EQ(frame.segments.at(1).class_index, 0);
  EXPECT_FALSE(frame.segments.at(3).is_crowd);
  EXPECT_TRUE(frame.segments.at(4).is_crowd);
  dir_.Write("instance-filt/0.png", Png8({1, 2}));
  EXPECT_THAT(ReadError(MaskFormat::kScanNet), HasSubstr("2 x 1 px, but its labels"));
  std::filesystem::remove(dir_ / "instance-filt/0.png");
  EXPECT_THAT(ReadError(MaskFormat::kScanNet), HasSubstr("instance-filt/0.png: cannot open"));
}

TEST_F(MaskFormats, SegmentsOfHuggingFace) {
  dir_.Write("a.npy", Npy<int64_t>("<i8", "1, 5", {1, 2, -1, 0, 3}));
  dir_.Write("a.json", R"({"segments_info": [
      {"id": 1, "label_id": 0, "was_fused": false, "score": 0.9},
      {"id": 2, "label_id": 1, "was_fused": true, "score": 0.5},
      {"id": 3, "label_id": 2, "score": 0.5}]})");
  const LabelMap map{"map.json", {{0, 7}, {1, 26}, {2, std::nullopt}}};
  const PanopticFrame frame = Read(MaskFormat::kSegments, map);
  EXPECT_EQ(Row(frame), (Ids{1, 2, kVoid, kVoid, kVoid}));
  EXPECT_EQ(frame.segments.at(1).class_index, 0);
  EXPECT_DOUBLE_EQ(frame.segments.at(1).score, 0.9);
  EXPECT_TRUE(frame.segments.at(2).is_crowd);
}

TEST_F(MaskFormats, SegmentsOfDetectron2) {
  dir_.Write("a.png", Png8({1, 2, 0, 255}));
  dir_.Write("a.json", R"([{"id": 1, "category_id": 7, "isthing": false},
                           {"id": 2, "category_id": 26, "isthing": true}])");
  EXPECT_EQ(Row(Read(MaskFormat::kSegments)), (Ids{1, 2, kVoid, kVoid}));
  dir_.Write("a.png", Png8({1, 2, 5}));
  EXPECT_THAT(ReadError(MaskFormat::kSegments),
              AllOf(HasSubstr("segment 5 is not in"), HasSubstr("with interpolation?")));
  dir_.Write("a.json", "{}");
  EXPECT_THAT(ReadError(MaskFormat::kSegments), HasSubstr("'segments_info' is missing"));
  std::filesystem::remove(dir_ / "a.json");
  EXPECT_THAT(ReadError(MaskFormat::kSegments), HasSubstr("a.json: cannot open"));
}

TEST_F(MaskFormats, SegmentsWhoseStuffIsNumberedApart) {
  dir_.Write("a.png", Png8({1, 2, 3}));
  const LabelMap map{"map.json", {{0, 26}, {1, 26}}, {{0, std::nullopt}, {1, 7}}};
  const auto write = [&](const std::string& second) {
    dir_.Write("a.json", R"([{"id": 1, "category_id": 1, "isthing": true}, {"id": 2, )" + second +
                             R"(}, {"id": 3, "category_id": 0, "isthing": 0}])");
  };
  write(R"("category_id": 1, "isthing": false)");
  const PanopticFrame frame = Read(MaskFormat::kSegments, map);
  EXPECT_EQ(Row(frame), (Ids{1, 2, kVoid}));
  EXPECT_EQ(frame.segments.at(1).class_index, 1);
  EXPECT_EQ(frame.segments.at(2).class_index, 0);
  const auto error = [&](const std::string& second) {
    write(second);
    return ReadError(MaskFormat::kSegments, map);
  };
  EXPECT_THAT(error(R"("category_id": 2, "isthing": false)"),
              HasSubstr("segment 2: label 2 is not in the label map map.json, among stuff"));
  EXPECT_THAT(error(R"("category_id": 2, "isthing": true)"), HasSubstr("among things"));
  EXPECT_THAT(error(R"("label_id": 1)"), HasSubstr("no isthing says whether label 1"));
  EXPECT_THAT(error(R"("category_id": 1, "isthing": "no")"), HasSubstr("'isthing'"));
  EXPECT_THAT(error(R"("category_id": 1, "isthing": true, "distribution": {"1": 1.0})"),
              HasSubstr("segment 2: distribution: no isthing says whether label 1"));
}

TEST_F(MaskFormats, SegmentsOfAnotherKindThanTheirClass) {
  dir_.Write("a.png", Png8({1}));
  const auto error = [&](const std::string& entry, const LabelMap& map = {}) {
    dir_.Write("a.json", R"([{"id": 1, )" + entry + "}]");
    return ReadError(MaskFormat::kSegments, map);
  };
  EXPECT_THAT(error(R"("category_id": 26, "isthing": false)"),
              AllOf(HasSubstr("a.json: segment 1: isthing is false"),
                    HasSubstr("class 26 (car), which is a thing"), HasSubstr("coco_separated")));
  const LabelMap contiguous{"map.json", {{0, 7}, {1, 26}, {2, std::nullopt}}};
  EXPECT_THAT(error(R"("category_id": 0, "isthing": true)", contiguous),
              HasSubstr("isthing is true, but label 0 means class 7 (road), which is stuff"));
  EXPECT_EQ(error(R"("category_id": 2, "isthing": true)", contiguous), "");  // Void.
  const LabelMap exchanged{"map.json", {{0, 7}}, {{0, 26}}};
  EXPECT_THAT(error(R"("category_id": 0, "isthing": true)", exchanged),
              HasSubstr("isthing is true, but label 0 means class 7"));
}

TEST_F(MaskFormats, TablesOfThingsAndStuffNeedSegmentsThatSayWhichTheyAre) {
  const LabelMap map{"map.json", {{1, 26}}, {{1, 7}}};
  dir_.Write("a.png", Png8({1}));
  EXPECT_THAT(ReadError(MaskFormat::kLabels, map),
              AllOf(HasSubstr("map.json"), HasSubstr("not for format labels")));
}

TEST_F(MaskFormats, DistributionsOfSegments) {
  dir_.Write("a.png", Png8({1, 2}));
  const auto read = [&](const std::string& distribution) {
    dir_.Write("a.json",
               R"([{"id": 1, "category_id": 7}, {"id": 2, "distribution": )" + distribution + "}]");
    return Read(MaskFormat::kSegments);
  };
  EXPECT_THAT(read("[0.25, 0.75]").segments.at(2).distribution,
              ::testing::ElementsAre(0.25F, 0.75F));
  EXPECT_EQ(read("[0.25, 0.75]").segments.at(2).class_index, 1);
  EXPECT_EQ(read(R"({"7": 0.9, "26": 0.1})").segments.at(2).class_index, 0);
  const auto error = [&](const std::string& d) { return ErrorOf([&] { (void)read(d); }); };
  EXPECT_THAT(error("[0.25, 0.7]"), HasSubstr("sums to 0.95"));
  EXPECT_THAT(error("[1.25, -0.25]"), HasSubstr("probability 1.25"));
  EXPECT_THAT(error("[0.5, null]"), HasSubstr("probability null"));
  EXPECT_THAT(error("[1.0]"), HasSubstr("distribution over 1 classes"));
  EXPECT_THAT(error(R"({"8": 1.0})"), HasSubstr("class 8"));
  EXPECT_THAT(error(R"({"x": 1.0})"), HasSubstr("'x'"));
  EXPECT_THAT(error("3"), HasSubstr("neither a list nor an object"));
}

TEST_F(MaskFormats, Labels) {
  // Two cars apart, then one pixel of the type's void.
  dir_.Write("a.png", Png8({7, 26, 26, 7, 26, 255, 0}));
  const PanopticFrame frame = Read(MaskFormat::kLabels);
  EXPECT_EQ(Row(frame), (Ids{1, 2, 2, 1, 3, kVoid, kVoid}));
  EXPECT_EQ(frame.segments.at(1).class_index, 0);
  EXPECT_EQ(frame.segments.at(3).class_index, 1);
  dir_.Write("a.png", Png8({7, 99}));
  EXPECT_THAT(ReadError(MaskFormat::kLabels), HasSubstr("class 99"));
}

TEST_F(MaskFormats, LabelsWithPalette) {
  // Made by Pillow: indices 7, 26 of a palette of distinct colours.
  dir_.Write("a.png", FromHex(kPalettePng));
  EXPECT_EQ(Row(Read(MaskFormat::kLabels)), (Ids{1, 2}));
}

// Two pixels, made by hand: indices 7, 26 of 256 black colours, the first of them transparent;
// indices 7, 10 of 16; and gray 7, 10 of 15.
constexpr const char* kOneColourPng =
    "89504e470d0a1a0a0000000d4948445200000002000000010803000000c3fc8fb800000300504c54"
    "45000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000000000000000000000000000"
    "000000000000000000b330f4880000000174524e530040e6d8660000000b49444154789c63609702"
    "00002b0022c085f9150000000049454e44ae426082";
constexpr const char* kFourBitPalettePng =
    "89504e470d0a1a0a0000000d4948445200000002000000010403000000060c62b900000030504c54"
    "45090909090909090909090909090909090909090909090909090909090909090909090909090909"
    "09090909090909090903de8f030000000a49444154789c63a80200007c007b142a09ee0000000049"
    "454e44ae426082";
constexpr const char* kFourBitGrayPng =
    "89504e470d0a1a0a0000000d494844520000000200000001040000000014b9cd570000000a494441"
    "54789c63a80200007c007b142a09ee0000000049454e44ae426082";

TEST_F(MaskFormats, PalettesMayRepeatColoursAndHaveFewBits) {
  dir_.Write("a.png", FromHex(kOneColourPng));
  EXPECT_EQ(Row(Read(MaskFormat::kLabels)), (Ids{1, 2}));
  dir_.Write("a.png", FromHex(kFourBitPalettePng));
  EXPECT_THAT(ReadError(MaskFormat::kLabels), HasSubstr("class 10"));
}

TEST_F(MaskFormats, GrayOfFewBitsIsRefused) {
  dir_.Write("a.png", FromHex(kFourBitGrayPng));
  EXPECT_THAT(ReadError(MaskFormat::kLabels), HasSubstr("gray of 4 bits"));
}

TEST_F(MaskFormats, SegmentsThatAreMostLikelyVoidAreVoid) {
  dir_.Write("a.png", Png8({1, 2}));
  const LabelMap map{"map.json", {{7, 7}, {8, std::nullopt}, {26, 26}}};
  const auto read = [&](const std::string& entry) {
    dir_.Write("a.json", R"([{"id": 1, "category_id": 7}, {"id": 2, )" + entry + "}]");
    return Read(MaskFormat::kSegments, map);
  };
  EXPECT_FALSE(read(R"("distribution": {"8": 0.6, "26": 0.4})").segments.contains(2));
  EXPECT_TRUE(read(R"("distribution": {"8": 0.4, "26": 0.6})").segments.contains(2));
  EXPECT_FALSE(read(R"("category_id": 8, "distribution": {"8": 1.0})").segments.contains(2));
  EXPECT_THAT(ErrorOf([&] { (void)read(R"("category_id": 26, "distribution": {"8": 1.0})"); }),
              HasSubstr("the whole distribution is void"));
}

TEST_F(MaskFormats, Probabilities) {
  const std::vector<float> p = {0.75F, 0.25F, 0.0F, 0.25F, 0.75F, 1.0F};
  dir_.Write("a.npy", Npy("<f4", "2, 1, 3", p));
  const PanopticFrame frame = Read(MaskFormat::kProbabilities);
  EXPECT_EQ(Row(frame), (Ids{1, 2, 2}));
  ASSERT_TRUE(frame.probabilities.has_value());
  EXPECT_THAT(frame.probabilities->ClassDistribution(0, 1, 2),
              ::testing::ElementsAre(0.25F, 0.75F));
}

TEST_F(MaskFormats, ProbabilitiesInHalfPrecision) {
  // 0.75, 0.25, 0, 0.25, 0.75, 1.
  dir_.Write("a.npy",
             Npy<uint16_t>("<f2", "2, 1, 3", {0x3A00, 0x3400, 0x0000, 0x3400, 0x3A00, 0x3C00}));
  const PanopticFrame frame = Read(MaskFormat::kProbabilities);
  EXPECT_THAT(frame.probabilities->ClassDistribution(0, 0, 2),
              ::testing::ElementsAre(0.75F, 0.25F));
}

TEST_F(MaskFormats, ProbabilitiesInNumPysArchive) {
  // numpy.savez_compressed of [[[255, 51, 0]], [[0, 204, 255]]] as uint8.
  const std::string archive = FromHex(kCompressedNpz);
  dir_.Write("a.npz", archive);
  const PanopticFrame frame = Read(MaskFormat::kProbabilities);
  EXPECT_EQ(Row(frame), (Ids{1, 2, 2}));
  EXPECT_NEAR(frame.probabilities->ClassDistribution(0, 1, 2)[0], 0.2F, 1e-6F);
  for (size_t size = 0; size < archive.size(); ++size) {
    dir_.Write("a.npz", archive.substr(0, size));
    EXPECT_THAT(ReadError(MaskFormat::kProbabilities), HasSubstr("a.npz: ")) << size;
  }
  for (size_t i = 30; i < archive.size() - 100; ++i) {
    std::string damaged = archive;
    damaged[i] ^= 0x10;
    dir_.Write("a.npz", damaged);
    // What does not change the array (names, sizes kept elsewhere) need not be noticed.
    const std::string error = ReadError(MaskFormat::kProbabilities);
    EXPECT_TRUE(error.empty() || error.find("a.npz: ") != std::string::npos) << error;
  }
}

TEST_F(MaskFormats, ProbabilitiesThatAreNone) {
  const auto error = [&](const std::string& shape, std::vector<float> p) {
    dir_.Write("a.npy", Npy("<f4", shape, p));
    return ReadError(MaskFormat::kProbabilities);
  };
  EXPECT_THAT(error("2, 1, 2", {0.5F, 0.5F, 0.5F, NAN}),
              HasSubstr("pixel (1, 0): probability nan"));
  EXPECT_THAT(error("2, 1, 2", {0.5F, 1.5F, 0.5F, -0.5F}), HasSubstr("probability -0.5"));
  EXPECT_THAT(error("2, 1, 2", {0.5F, 0.5F, 0.5F, 0.25F}), HasSubstr("sum to 0.75"));
  EXPECT_THAT(error("1, 1, 2", {1.0F, 1.0F}), HasSubstr("1 channels where the class table"));
  EXPECT_THAT(error("2, 2", {0.5F, 0.5F, 0.5F, 0.5F}), HasSubstr("2 dimensions"));
  EXPECT_THAT(error("2, 1, 3", {0.5F, 0.5F}), HasSubstr("do not fit shape"));
  dir_.Write("a.npy", Npy<int32_t>("<i4", "2, 1, 1", {0, 1}));
  EXPECT_THAT(ReadError(MaskFormat::kProbabilities), HasSubstr("items of type i4"));
}

TEST(LabelMap, ReadsJsonAndScanNetsTable) {
  const TempDir dir;
  const LabelMap json = ReadLabelMap(dir.Write("m.json", R"({"3": 7, "-1": null})"));
  EXPECT_EQ(json.class_of_label.at(3), 7);
  EXPECT_FALSE(json.class_of_label.at(-1).has_value());
  EXPECT_FALSE(json.NumbersStuffApart());
  const LabelMap apart =
      ReadLabelMap(dir.Write("m.json", R"({"things": {"1": 2}, "stuff": {"0": null, "1": 3}})"));
  EXPECT_TRUE(apart.NumbersStuffApart());
  EXPECT_EQ(apart.class_of_label.at(1), 2);
  EXPECT_EQ(apart.class_of_stuff.at(1), 3);
  EXPECT_FALSE(apart.class_of_stuff.at(0).has_value());
  const LabelMap tsv = ReadLabelMap(
      dir.Write("m.tsv", "id\traw_category\tnyu40id\n1\twall\t1\n22\tthing\t40\n40\tfoo\t\n"));
  EXPECT_EQ(tsv.class_of_label.at(22), 40);
  EXPECT_FALSE(tsv.class_of_label.at(40).has_value());
  EXPECT_FALSE(tsv.class_of_label.at(0).has_value());
  const auto error = [&](const std::string& name, const std::string& text) {
    return ErrorOf([&] { (void)ReadLabelMap(dir.Write(name, text)); });
  };
  EXPECT_THAT(error("m.json", "[]"), HasSubstr("a label map is an object"));
  EXPECT_THAT(error("m.json", "{}"), HasSubstr("empty"));
  EXPECT_THAT(error("m.json", R"({"a": 1})"), HasSubstr("'a' is not an integer"));
  EXPECT_THAT(error("m.json", R"({"1": "x"})"), HasSubstr("label 1"));
  EXPECT_THAT(error("m.json", R"({"things": {"1": 2}})"),
              HasSubstr("'things' and 'stuff' are due"));
  EXPECT_THAT(error("m.json", R"({"things": {"1": 2}, "stuff": {"1": 3}, "4": 5})"),
              HasSubstr("and no more"));
  EXPECT_THAT(error("m.json", R"({"things": {"1": 2}, "stuff": {}})"),
              HasSubstr("stuff: the label map is empty"));
  EXPECT_THAT(error("m.json", R"({"things": {"1": "x"}, "stuff": {"1": 3}})"),
              HasSubstr("things: label 1"));
  EXPECT_THAT(error("m.tsv", "id\tname\n1\tx\n"), HasSubstr("'nyu40id'"));
  EXPECT_THAT(error("m.tsv", "id\tnyu40id\n1\n"), HasSubstr("m.tsv:2"));
}

TEST(LabelMap, ThoseProvidedFitTheirTables) {
  const std::filesystem::path configs = std::filesystem::path(S3LAM_TEST_SOURCE_DIR) / "configs";
  const auto check = [&](const char* map_name, const char* table_name, size_t mapped) {
    const LabelMap map = ReadLabelMap(configs / "label_maps" / map_name);
    const ClassTable table = ReadClassTable(configs / "classes" / table_name);
    std::set<int> classes;
    const auto check_classes = [&](const LabelMap::Classes& class_of_label, bool is_stuff) {
      for (const auto& [label, class_id] : class_of_label) {
        if (!class_id) continue;
        const auto index = table.IndexOfId(*class_id);
        ASSERT_TRUE(index.has_value()) << *class_id;
        EXPECT_TRUE(classes.insert(*class_id).second) << *class_id;
        if (!map.NumbersStuffApart()) continue;
        EXPECT_EQ(table.classes[static_cast<size_t>(*index)].is_thing, !is_stuff) << *class_id;
      }
    };
    check_classes(map.class_of_label, false);
    check_classes(map.class_of_stuff, true);
    EXPECT_EQ(classes.size(), mapped);
  };
  check("coco_contiguous.json", "coco.json", 133);
  check("coco_separated.json", "coco.json", 133);
  check("cityscapes_ids.json", "cityscapes.json", 19);
  check("ade20k_zero_based.json", "ade20k.json", 150);
}

}  // namespace
}  // namespace s3lam
