#include <gtest/gtest.h>

#include <filesystem>

#include "s3lam/io/image_sequence.h"

namespace s3lam {
namespace {

TEST(RealSequences, AreRecognised) {
  const std::filesystem::path data = S3LAM_TEST_DATA_DIR;
  if (data.empty()) GTEST_SKIP() << "no folder with real sequences given";
  const ImageSequence kitti = OpenSequence(data / "kitti07", SequenceFormat::kAuto);
  EXPECT_EQ(kitti.format, SequenceFormat::kKitti);
  EXPECT_EQ(kitti.frames.size(), 160u);
  EXPECT_EQ(kitti.camera.value().width, 1226);
  const ImageSequence euroc = OpenSequence(data / "mh05", SequenceFormat::kAuto);
  EXPECT_EQ(euroc.format, SequenceFormat::kEuroc);
  EXPECT_EQ(euroc.frames.size(), 585u);
  EXPECT_EQ(euroc.camera.value().model, CameraModel::kOpenCv);
  const ImageSequence tum = OpenSequence(data / "redkitchen", SequenceFormat::kAuto);
  EXPECT_EQ(tum.format, SequenceFormat::kTum);
  EXPECT_EQ(tum.frames.size(), 1000u);
  EXPECT_EQ(tum.camera.value().model, CameraModel::kSimpleRadial);
  for (const ImageSequence* sequence : {&kitti, &euroc, &tum}) {
    const cv::Mat image = FrameReader(*sequence).ReadGray(sequence->frames.size() / 2);
    EXPECT_EQ(image.size(), cv::Size(sequence->camera->width, sequence->camera->height));
  }
}

}  // namespace
}  // namespace s3lam
