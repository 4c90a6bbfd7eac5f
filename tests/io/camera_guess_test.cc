#include "s3lam/io/camera_guess.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "s3lam/io/file.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

struct Entry {
  unsigned tag;
  unsigned type;  // 3: 16 bits, 4: 32 bits, 5: a ratio.
  unsigned value;
  unsigned denominator = 1;
};

/// Builds the EXIF data of a JPEG file, in either order of bytes.
class ExifBuilder {
 public:
  explicit ExifBuilder(bool big_endian) : big_endian_(big_endian) {}

  /// A whole JPEG file: the image with the EXIF data behind its first marker.
  std::string Insert(const std::string& jpeg, const std::vector<Entry>& entries) {
    tiff_ = big_endian_ ? "MM" : "II";
    Put(42, 2);
    Put(8, 4);
    Put(1, 2);
    Put({0x8769, 4, 26});
    Put(0, 4);
    std::vector<Entry> ratios;
    Put(static_cast<unsigned>(entries.size()), 2);
    const auto values = static_cast<unsigned>(26 + 2 + 12 * entries.size() + 4);
    for (Entry entry : entries) {
      if (entry.type == 5) {
        ratios.push_back(entry);
        entry.value = values + static_cast<unsigned>(8 * (ratios.size() - 1));
      }
      Put(entry);
    }
    Put(0, 4);
    for (const Entry& ratio : ratios) {
      Put(ratio.value, 4);
      Put(ratio.denominator, 4);
    }
    std::string segment("\xFF\xE1", 2);
    const size_t length = 2 + 6 + tiff_.size();
    segment += static_cast<char>(length >> 8);
    segment += static_cast<char>(length & 0xFF);
    segment += std::string("Exif\0\0", 6) + tiff_;
    return jpeg.substr(0, 2) + segment + jpeg.substr(2);
  }

 private:
  void Put(unsigned number, unsigned num_bytes) {
    for (unsigned i = 0; i < num_bytes; ++i) {
      const unsigned shift = 8 * (big_endian_ ? num_bytes - 1 - i : i);
      tiff_ += static_cast<char>(number >> shift & 0xFF);
    }
  }
  void Put(const Entry& entry) {
    Put(entry.tag, 2);
    Put(entry.type, 2);
    Put(1, 4);
    const bool is_short = entry.type == 3;
    Put(entry.value, is_short ? 2 : 4);
    if (is_short) Put(0, 2);
  }

  bool big_endian_;
  std::string tiff_;
};

std::string EncodeJpeg(int width, int height) {
  std::vector<uint8_t> bytes;
  cv::imencode(".jpg", cv::Mat(height, width, CV_8U, cv::Scalar(90)), bytes);
  return {bytes.begin(), bytes.end()};
}

class Exif : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Orders, Exif, ::testing::Bool());

TEST_P(Exif, FocalLengthOnFilmIsTakenByTheDiagonal) {
  const std::string jpeg = ExifBuilder(GetParam()).Insert(EncodeJpeg(64, 48), {{0xA405, 3, 28}});
  const auto focal = ExifFocalLength(jpeg, 640, 480);
  ASSERT_TRUE(focal.has_value());
  EXPECT_NEAR(*focal, 28.0 * 800.0 / 43.27, 1e-6);
}

TEST_P(Exif, FocalLengthAndSizeOfThePixelsAreTakenAtTheImagesScale) {
  // 5 mm, 4000 px in 6.4 mm: 625 px/mm, or 6250 px/cm.
  const std::string jpeg =
      ExifBuilder(GetParam())
          .Insert(EncodeJpeg(64, 48),
                  {{0x920A, 5, 50, 10}, {0xA002, 4, 4000}, {0xA20E, 5, 6250, 1}, {0xA210, 3, 3}});
  EXPECT_NEAR(ExifFocalLength(jpeg, 4000, 3000).value(), 5.0 * 625.0, 1e-6);
  EXPECT_NEAR(ExifFocalLength(jpeg, 1000, 750).value(), 5.0 * 625.0 / 4.0, 1e-6);
}

TEST(ExifFocalLength, IsEmptyForWhatIsNoLens) {
  const std::string image = EncodeJpeg(64, 48);
  EXPECT_FALSE(ExifFocalLength(image, 640, 480));
  EXPECT_FALSE(ExifFocalLength("", 640, 480));
  ExifBuilder builder(false);
  EXPECT_FALSE(ExifFocalLength(builder.Insert(image, {{0xA405, 3, 0}}), 640, 480));
  EXPECT_FALSE(ExifFocalLength(builder.Insert(image, {{0xA405, 3, 2}}), 640, 480));
  EXPECT_FALSE(
      ExifFocalLength(builder.Insert(image, {{0x920A, 5, 50, 0}, {0xA20E, 5, 9, 1}}), 640, 480));
}

TEST(ExifFocalLength, EveryTruncationIsSurvived) {
  const std::string jpeg = ExifBuilder(true).Insert(
      EncodeJpeg(16, 16), {{0x920A, 5, 50, 10}, {0xA20E, 5, 6250, 1}, {0xA210, 3, 3}});
  ASSERT_TRUE(ExifFocalLength(jpeg, 640, 480));
  int found = 0;
  for (size_t size = 0; size < jpeg.size(); ++size) {
    found += ExifFocalLength(std::string_view(jpeg).substr(0, size), 640, 480).has_value();
  }
  EXPECT_GT(found, 0);  // What is missing behind the EXIF data does not matter.
  EXPECT_LT(found, static_cast<int>(jpeg.size()) - 90);
}

TEST(GuessCamera, TakesExifElseACommonLens) {
  const testing::TempDir dir;
  const auto write = [&](const std::string& bytes) {
    WriteFile(dir / "0.jpg", [&](std::ostream& stream) { stream << bytes; });
    return GuessCamera(OpenSequence(dir.path(), SequenceFormat::kFolder));
  };
  const CameraGuess by_exif =
      write(ExifBuilder(false).Insert(EncodeJpeg(64, 48), {{0xA405, 3, 50}}));
  EXPECT_EQ(by_exif.source, "EXIF");
  EXPECT_NEAR(by_exif.camera.FocalX(), 50.0 * 80.0 / 43.27, 1e-6);
  const CameraGuess by_size = write(EncodeJpeg(64, 48));
  EXPECT_EQ(by_size.source, "field of view");
  EXPECT_GT(by_size.relative_sigma, by_exif.relative_sigma);
  EXPECT_NEAR(by_size.camera.FocalX(), 28.0 / 36.0 * 64.0, 1e-6);
  EXPECT_EQ(by_size.camera.PrincipalX(), 32.0);
  EXPECT_EQ(by_size.camera.PrincipalY(), 24.0);
  by_size.camera.Check("guess");
}

}  // namespace
}  // namespace s3lam
