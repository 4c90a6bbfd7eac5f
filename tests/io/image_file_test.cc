#include "s3lam/io/image_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::TempDir;
using ::testing::ThrowsMessage;

cv::Mat NoisyImage(int channels) {
  Rng rng(11);
  cv::Mat image(48, 64, CV_8UC(channels));
  for (int i = 0; i < image.rows * image.cols * channels; ++i) {
    image.data[i] = static_cast<uint8_t>(rng.Below(256));
  }
  return image;
}

std::string Encode(const char* extension, const cv::Mat& image,
                   const std::vector<int>& parameters = {}) {
  std::vector<uchar> bytes;
  cv::imencode(extension, image, bytes, parameters);
  return {bytes.begin(), bytes.end()};
}

class ImageFileFormat : public ::testing::TestWithParam<const char*> {};

TEST_P(ImageFileFormat, ReadsColourGrayAndSize) {
  const TempDir dir;
  const std::string name = std::string("image") + GetParam();
  const auto path = dir.Write(name, Encode(GetParam(), NoisyImage(3)));
  EXPECT_EQ(ReadImageFile(path, cv::IMREAD_ANYCOLOR).type(), CV_8UC3);
  EXPECT_EQ(ReadImageFile(path, cv::IMREAD_GRAYSCALE).type(), CV_8UC1);
  EXPECT_EQ(ReadImageFile(path, cv::IMREAD_ANYCOLOR).size(), cv::Size(64, 48));
  EXPECT_EQ(ReadImageSize(path), cv::Size(64, 48));
  EXPECT_TRUE(HasImageExtension(path));
}

TEST_P(ImageFileFormat, EveryTruncationIsAnErrorThatNamesTheFile) {
  const TempDir dir;
  const std::string name = std::string("image") + GetParam();
  const std::string whole = Encode(GetParam(), NoisyImage(3));
  for (size_t size = 0; size < whole.size(); size += 1 + whole.size() / 97) {
    const auto path = dir.Write(name, whole.substr(0, size));
    EXPECT_THAT([&] { (void)ReadImageFile(path, cv::IMREAD_ANYCOLOR); },
                ThrowsMessage<InputError>(HasSubstr(name)))
        << size;
  }
}

INSTANTIATE_TEST_SUITE_P(Formats, ImageFileFormat,
                         ::testing::Values(".jpg", ".png", ".bmp", ".tif", ".ppm"),
                         [](const auto& format) { return std::string(format.param + 1); });

TEST(ImageFile, EveryByteCutFromAJpegIsNoticed) {
  // OpenCV decodes all of these without a word.
  const TempDir dir;
  for (const int progressive : {0, 1}) {
    const std::string whole =
        Encode(".jpg", NoisyImage(3), {cv::IMWRITE_JPEG_PROGRESSIVE, progressive});
    for (size_t cut = 1; cut <= 64; ++cut) {
      const auto path = dir.Write("image.jpg", whole.substr(0, whole.size() - cut));
      EXPECT_THAT([&] { (void)ReadImageFile(path, cv::IMREAD_ANYCOLOR); },
                  ThrowsMessage<InputError>(HasSubstr("cut short")));
    }
    EXPECT_FALSE(ReadImageFile(dir.Write("image.jpg", whole), cv::IMREAD_ANYCOLOR).empty());
  }
}

TEST(ImageFile, BytesAfterTheEndOfAnImageAreIgnored) {
  const TempDir dir;
  for (const char* extension : {".jpg", ".png"}) {
    const std::string bytes = Encode(extension, NoisyImage(3)) + std::string(100, '\0') + "tail";
    const auto path = dir.Write(std::string("image") + extension, bytes);
    EXPECT_EQ(ReadImageFile(path, cv::IMREAD_ANYCOLOR).size(), cv::Size(64, 48));
  }
}

TEST(ImageFile, AnEmbeddedPreviewDoesNotHideACut) {
  // An application segment that holds a whole JPEG of its own, end marker included.
  const TempDir dir;
  const std::string whole = Encode(".jpg", NoisyImage(3));
  const std::string preview = Encode(".jpg", NoisyImage(1)(cv::Rect(0, 0, 8, 8)).clone());
  const size_t length = preview.size() + 2;
  std::string segment = "\xFF\xE1";
  segment += static_cast<char>(length >> 8);
  segment += static_cast<char>(length & 0xFF);
  segment += preview;
  const std::string bytes = whole.substr(0, 2) + segment + whole.substr(2);
  const auto path = dir.Write("image.jpg", bytes);
  EXPECT_EQ(ReadImageSize(path), cv::Size(64, 48));
  EXPECT_EQ(ReadImageFile(path, cv::IMREAD_ANYCOLOR).size(), cv::Size(64, 48));
  dir.Write("image.jpg", bytes.substr(0, bytes.size() - 2));
  EXPECT_THROW((void)ReadImageFile(path, cv::IMREAD_ANYCOLOR), InputError);
}

TEST(ImageFile, ExifOrientationIsNotApplied) {
  // Orientation 6 (turn by 90 degrees) in a minimal EXIF segment.
  const std::string exif(
      "\xFF\xE1\x00\x22"
      "Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0",
      36);
  const std::string whole = Encode(".jpg", NoisyImage(3));
  const TempDir dir;
  const auto path = dir.Write("image.jpg", whole.substr(0, 2) + exif + whole.substr(2));
  ASSERT_EQ(cv::imread(path.string(), cv::IMREAD_ANYCOLOR).size(), cv::Size(48, 64));
  EXPECT_EQ(ReadImageFile(path, cv::IMREAD_ANYCOLOR).size(), cv::Size(64, 48));
}

TEST(ImageFile, WhatIsNoImageIsRefused) {
  const TempDir dir;
  const auto expect_error = [&](const std::string& bytes, const std::string& message) {
    const auto path = dir.Write("image.png", bytes);
    EXPECT_THAT([&] { (void)ReadImageFile(path, cv::IMREAD_ANYCOLOR); },
                ThrowsMessage<InputError>(AllOf(HasSubstr("image.png"), HasSubstr(message))));
    EXPECT_THROW((void)ReadImageSize(path), InputError);
  };
  expect_error("", "empty");
  expect_error("hello", "not an image");
  // What OpenCV's library for maps would take for a list of further files to open.
  expect_error("<VRTDataset rasterXSize=\"4\" rasterYSize=\"4\"></VRTDataset>", "not an image");
  EXPECT_THROW((void)ReadImageFile(dir / "absent.png", cv::IMREAD_ANYCOLOR), InputError);
}

TEST(ImageFile, WhatOpenCvTakesForDicomIsRefusedWhateverItBeginsWith) {
  const TempDir dir;
  for (const char* extension : {".pgm", ".png", ".jpg", ".webp"}) {
    std::string bytes = Encode(extension, NoisyImage(1));
    ASSERT_GT(bytes.size(), 132U);
    bytes.replace(128, 4, "DICM");
    const auto path = dir.Write(std::string("image") + extension, bytes);
    EXPECT_THAT([&] { (void)ReadImageFile(path, cv::IMREAD_ANYCOLOR); },
                ThrowsMessage<InputError>(HasSubstr("not an image, or damaged: JPEG, PNG")));
  }
}

TEST(ImageFile, SizesThatAFileCannotHoldAreRefusedBeforeDecoding) {
  const TempDir dir;
  const auto expect_refused = [&](const std::string& bytes, const std::string& size) {
    const auto path = dir.Write("image", bytes);
    EXPECT_THAT([&] { (void)ReadImageFile(path, cv::IMREAD_ANYCOLOR); },
                ThrowsMessage<InputError>(
                    AllOf(HasSubstr(size), HasSubstr("damaged"), HasSubstr("cannot be"))));
  };
  expect_refused("P1 20000;9995", "20000 x 9995");
  expect_refused("P5 #comment\n 20000\n9995 255\n", "20000 x 9995");
  const std::string pgm = Encode(".pgm", NoisyImage(1));
  const std::string ppm = Encode(".ppm", NoisyImage(3));
  expect_refused(pgm.substr(0, 48 * 64 - 1), "64 x 48");
  expect_refused(ppm.substr(0, 3 * 48 * 64 - 1), "64 x 48");
  std::string bmp = Encode(".bmp", NoisyImage(3));
  bmp[20] = 1;  // The third byte of the width.
  expect_refused(bmp, "65600 x 48");
  bmp[30] = 1;   // Compressed by run lengths, and too large even so.
  bmp[23] = 16;  // The second byte of the height.
  expect_refused(bmp, "65600 x 4144");
}

/// A TIFF of one directory with these entries of type LONG, whose other bytes do not matter.
std::string TiffHeader(const std::vector<std::pair<uint16_t, uint32_t>>& entries) {
  std::string bytes("II*\0\x08\0\0\0", 8);
  const auto append = [&](uint32_t value, int num_bytes) {
    for (int i = 0; i < num_bytes; ++i) bytes += static_cast<char>(value >> 8 * i & 0xFF);
  };
  append(static_cast<uint32_t>(entries.size()), 2);
  for (const auto& [tag, value] : entries) {
    append(tag, 2);
    append(4, 2);  // LONG
    append(1, 4);
    append(value, 4);
  }
  return bytes + std::string(200, '\0');
}

TEST(ImageFile, TiffSizesThatAFileCannotHoldAreRefusedBeforeDecoding) {
  const TempDir dir;
  const auto expect_refused = [&](const std::string& bytes, const std::string& message) {
    const auto path = dir.Write("image.tif", bytes);
    EXPECT_THAT([&] { (void)ReadImageFile(path, cv::IMREAD_ANYCOLOR); },
                ThrowsMessage<InputError>(AllOf(HasSubstr("image.tif"), HasSubstr(message))));
  };
  expect_refused(TiffHeader({{256, 60000}, {257, 60000}}), "60000 x 60000 px is too large");
  expect_refused(TiffHeader({{256, 4294967295U}, {257, 4294967295U}}), "is too large");
  // Without compression, by LZW, JPEG, Deflate of both numbers and run lengths.
  for (const uint32_t compression : {1U, 5U, 7U, 8U, 32946U, 32773U}) {
    expect_refused(TiffHeader({{256, 20000}, {257, 9995}, {258, 8}, {259, compression}}),
                   "cannot be an image of 20000 x 9995 px");
  }
  // A small image in a huge tile.
  expect_refused(TiffHeader({{256, 16}, {257, 16}, {258, 8}, {259, 1}, {322, 65536}, {323, 65536}}),
                 "cannot be an image of 16 x 16 px");
  // As BigTIFF, the most significant byte first: 60000 x 60000, as SHORT.
  const std::string entries(
      "\x01\0\0\x03\0\0\0\0\0\0\0\x01\xEA\x60\0\0\0\0\0\0"
      "\x01\x01\0\x03\0\0\0\0\0\0\0\x01\xEA\x60\0\0\0\0\0\0",
      40);
  expect_refused(std::string("MM\0+\0\x08\0\0\0\0\0\0\0\0\0\x10\0\0\0\0\0\0\0\x02", 24) + entries,
                 "60000 x 60000 px is too large");
  // A directory outside of the file, and an endless one: nothing is claimed, the decoder refuses
  // them.
  expect_refused(std::string("II*\0\xff\xff\xff\xff", 8), "image.tif");
  expect_refused(std::string("II*\0\x08\0\0\0\xff\xff", 10), "image.tif");
}

TEST(ImageFile, TiffsThatArePackedAsTightlyAsCanBeAreRead) {
  const TempDir dir;
  const cv::Mat even(2000, 3000, CV_8UC3, cv::Scalar(7, 7, 7));
  for (const int compression : {1, 5, 8, 32773, 32946}) {
    const auto path =
        dir.Write("image.tif", Encode(".tif", even, {cv::IMWRITE_TIFF_COMPRESSION, compression}));
    EXPECT_EQ(ReadImageFile(path, cv::IMREAD_ANYCOLOR).size(), even.size()) << compression;
  }
}

TEST(ImageFile, WebpSizesThatAFileCannotHoldAreRefusedBeforeDecoding) {
  if (!cv::haveImageWriter("image.webp")) GTEST_SKIP() << "OpenCV was built without WebP";
  const TempDir dir;
  const auto expect_refused = [&](const std::string& bytes, const std::string& message) {
    const auto path = dir.Write("image.webp", bytes);
    EXPECT_THAT([&] { (void)ReadImageFile(path, cv::IMREAD_ANYCOLOR); },
                ThrowsMessage<InputError>(AllOf(HasSubstr("image.webp"), HasSubstr(message))));
  };
  std::string lossy = Encode(".webp", NoisyImage(3), {cv::IMWRITE_WEBP_QUALITY, 50});
  ASSERT_EQ(lossy.substr(12, 4), "VP8 ");
  lossy.replace(26, 4, "\xff\x3f\xff\x3f");
  expect_refused(lossy, "cannot be an image of 16383 x 16383 px");
  std::string extended = lossy;
  extended.replace(12, 4, "VP8X");
  extended.replace(24, 6, "\x5f\xea\0\x5f\xea\0", 6);
  expect_refused(extended, "60000 x 60000 px is too large");
  // Without loss, one colour takes next to nothing, whatever the size.
  for (const int quality : {50, 101}) {
    const cv::Mat even(2000, 3000, CV_8UC3, cv::Scalar(7, 7, 7));
    const auto path =
        dir.Write("image.webp", Encode(".webp", even, {cv::IMWRITE_WEBP_QUALITY, quality}));
    EXPECT_EQ(ReadImageFile(path, cv::IMREAD_ANYCOLOR).size(), even.size()) << quality;
  }
}

TEST(ImageFile, ADamagedPngIsRefused) {
  const TempDir dir;
  std::string bytes = Encode(".png", NoisyImage(3));
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] + 1);
  EXPECT_THROW((void)ReadImageFile(dir.Write("image.png", bytes), cv::IMREAD_ANYCOLOR), InputError);
}

}  // namespace
}  // namespace s3lam
