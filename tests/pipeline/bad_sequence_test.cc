// What s3-slam says to sequences that cannot be used.

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/program_test_support.h"

namespace s3lam {
namespace {

using testing::FileBytes;
using testing::kBadInput;
using testing::TempDir;

constexpr const char* kCamera =
    R"({"model": "PINHOLE", "width": 160, "height": 120, "params": [150, 150, 80, 60], "fps": 30})";

/// A folder of five images full of corners, but of no scene.
class BadSequence : public testing::RefusedTest {
 protected:
  BadSequence() {
    sequence_.Write("camera.json", kCamera);
    cv::Mat noise(120, 160, CV_8UC1);
    for (int i = 0; i < kFrames; ++i) {
      cv::theRNG().state = static_cast<uint64_t>(i + 1);
      cv::randu(noise, 0, 255);
      cv::blur(noise, noise, cv::Size(3, 3));
      cv::imwrite(Image(i).string(), noise);
    }
  }

  [[nodiscard]] std::filesystem::path Image(int i) const {
    return sequence_ / ("frame" + std::to_string(i) + ".png");
  }

  void ExpectSequenceRefused(const std::vector<std::string>& parts,
                             const std::vector<std::string>& more_arguments = {},
                             int exit_code = kBadInput) {
    std::vector<std::string> arguments = {"--sequence", sequence_.path().string()};
    arguments.insert(arguments.end(), more_arguments.begin(), more_arguments.end());
    ExpectRefusedWithoutTrace("s3-slam", arguments, exit_code, parts);
  }

  static constexpr int kFrames = 5;
  TempDir sequence_;
};

TEST_F(BadSequence, MissingFolder) {
  ExpectRefusedWithoutTrace("s3-slam", {"--sequence", "/nonexistent/sequence"}, kBadInput,
                            {"/nonexistent/sequence"});
}

TEST_F(BadSequence, EmptyFolder) {
  const TempDir empty;
  ExpectRefusedWithoutTrace("s3-slam", {"--sequence", empty.path().string()}, kBadInput,
                            {empty.path().string()});
}

TEST_F(BadSequence, WrongUsageIsSaidBeforeAnythingIsRead) {
  ExpectRefusedWithoutTrace("s3-slam",
                            {"--sequence", "/nonexistent/sequence", "--checkpoint-every=-1"},
                            testing::kWrongUsage, {"--checkpoint-every"});
}

TEST_F(BadSequence, NoScene) { ExpectSequenceRefused({"map"}); }

TEST_F(BadSequence, NoCamera) {
  std::filesystem::remove(sequence_ / "camera.json");
  ExpectSequenceRefused({sequence_.path().string(), "camera"});
}

TEST_F(BadSequence, CameraWithoutIntrinsics) {
  sequence_.Write("camera.json", R"({"model": "PINHOLE", "width": 160, "height": 120})");
  ExpectSequenceRefused({"camera.json", "params"});
}

TEST_F(BadSequence, CameraWithTooFewParameters) {
  const auto camera = sequence_.Write(
      "other.json",
      R"({"model": "OPENCV", "width": 160, "height": 120, "params": [150, 150, 80, 60]})");
  ExpectSequenceRefused({"other.json", "8 parameters"}, {"--camera", camera.string()});
}

TEST_F(BadSequence, CameraOfUnknownModel) {
  sequence_.Write("camera.json",
                  R"({"model": "PINHOLES", "width": 160, "height": 120, "params": [1, 1, 1, 1]})");
  ExpectSequenceRefused({"camera.json", "PINHOLES"});
}

TEST_F(BadSequence, MalformedCamera) {
  sequence_.Write("camera.json", R"({"model": "PINHOLE", )");
  ExpectSequenceRefused({"camera.json"});
}

TEST_F(BadSequence, CameraOfAnotherSize) {
  sequence_.Write("camera.json",
                  R"({"model": "PINHOLE", "width": 320, "height": 240, "params": [9, 9, 9, 9]})");
  ExpectSequenceRefused({Image(0).string(), "320", "160"});
}

TEST_F(BadSequence, TruncatedImageInTheMiddle) {
  const std::string bytes = FileBytes(Image(2));
  sequence_.Write(Image(2).filename(), bytes.substr(0, bytes.size() / 2));
  ExpectSequenceRefused({Image(2).string()});
}

TEST_F(BadSequence, TruncatedJpegInTheMiddle) {
  const cv::Mat image = cv::imread(Image(2).string());
  std::filesystem::remove(Image(2));
  const auto jpeg = Image(2).replace_extension(".jpg");
  cv::imwrite(jpeg.string(), image);
  const std::string bytes = FileBytes(jpeg);
  sequence_.Write(jpeg.filename(), bytes.substr(0, bytes.size() / 2));
  ExpectSequenceRefused({jpeg.string()});
}

TEST_F(BadSequence, NotAnImage) {
  sequence_.Write(Image(3).filename(), "not an image");
  ExpectSequenceRefused({Image(3).string()});
}

TEST_F(BadSequence, EmptyImage) {
  sequence_.Write(Image(4).filename(), "");
  ExpectSequenceRefused({Image(4).string()});
}

TEST_F(BadSequence, ListedImageIsMissing) {
  sequence_.Write("rgb.txt", "0.0 frame0.png\n0.1 frame1.png\n0.2 absent.png\n");
  ExpectSequenceRefused({"absent.png"});
}

TEST_F(BadSequence, TimesDoNotIncrease) {
  sequence_.Write("rgb.txt", "0.0 frame0.png\n0.2 frame1.png\n0.1 frame2.png\n");
  ExpectSequenceRefused({sequence_.path().string(), "frame2.png"});
}

TEST_F(BadSequence, EmptyRange) { ExpectSequenceRefused({"range"}, {"--frames", "100:200"}); }

TEST_F(BadSequence, VideoThatIsNone) {
  const auto video = sequence_.Write("video.mp4", "no video at all");
  ExpectRefusedWithoutTrace("s3-slam", {"--sequence", video.string()}, kBadInput, {video.string()});
}

}  // namespace
}  // namespace s3lam
