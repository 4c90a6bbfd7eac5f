#include "s3lam/io/image_sequence.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include "s3lam/base/error.h"
#include "support/captured_log.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::TempDir;
using ::testing::ThrowsMessage;

constexpr const char* kCameraJson =
    R"({"model": "PINHOLE", "width": 32, "height": 24, "params": [30, 31, 16, 12], "fps": 10})";

/// An image of 32 x 24 px whose gray value tells its number.
std::string EncodedImage(int number, const char* extension = ".png", int type = CV_8UC1) {
  std::vector<uchar> bytes;
  cv::imencode(extension, cv::Mat(24, 32, type, cv::Scalar::all(10 * number)), bytes);
  return {bytes.begin(), bytes.end()};
}

std::vector<std::string> Names(const ImageSequence& sequence) {
  std::vector<std::string> names;
  for (const SequenceFrame& frame : sequence.frames) names.push_back(frame.name);
  return names;
}

std::vector<double> Times(const ImageSequence& sequence) {
  std::vector<double> times;
  for (const SequenceFrame& frame : sequence.frames) times.push_back(frame.time_s);
  return times;
}

void ExpectError(const std::filesystem::path& path, SequenceFormat format,
                 const std::string& message) {
  EXPECT_THAT([&] { OpenSequence(path, format); }, ThrowsMessage<InputError>(HasSubstr(message)));
}

TEST(FrameRange, FollowsSliceRules) {
  const auto expect = [](const std::string& text, int first, int end, int step) {
    const FrameRange range = ParseFrameRange(text);
    EXPECT_EQ(range.first, first) << text;
    EXPECT_EQ(range.end, end) << text;
    EXPECT_EQ(range.step, step) << text;
  };
  expect("3:10:2", 3, 10, 2);
  expect("3:10", 3, 10, 1);
  expect(":10", 0, 10, 1);
  expect("3:", 3, -1, 1);
  expect("::5", 0, -1, 5);
  expect(":", 0, -1, 1);
  for (const char* text :
       {"", "5", "a:b", "1:2:0", "1:2:-1", "-1:2", "1:2:3:4", "1:2:3 ", "1.5:2"}) {
    EXPECT_THROW(ParseFrameRange(text), UsageError) << text;
  }
}

TEST(SequenceFormat, NamesAreThoseOfTheCommandLine) {
  EXPECT_EQ(SequenceFormatFromName("kitti-raw"), SequenceFormat::kKittiRaw);
  EXPECT_EQ(SequenceFormatFromName("auto"), SequenceFormat::kAuto);
  EXPECT_FALSE(SequenceFormatFromName("KITTI").has_value());
}

TEST(FolderSequence, IsInNaturalOrderWithSubfolders) {
  const TempDir dir;
  for (const char* name : {"a10.png", "a9.png", "a09.PNG", "b/2.jpg", "b/10.jpg", "a/z.png",
                           ".hidden/x.png", ".y.png", "notes.txt"}) {
    dir.Write(name, EncodedImage(1));
  }
  const ImageSequence sequence = OpenSequence(dir.path(), SequenceFormat::kAuto);
  EXPECT_EQ(sequence.format, SequenceFormat::kFolder);
  EXPECT_THAT(Names(sequence),
              ElementsAre("a/z.png", "a09.PNG", "a9.png", "a10.png", "b/2.jpg", "b/10.jpg"));
  EXPECT_DOUBLE_EQ(sequence.frames[3].time_s, 0.1);  // 30 Hz if nobody says.
  EXPECT_FALSE(sequence.camera.has_value());
  dir.Write("camera.json", kCameraJson);
  const ImageSequence with_camera = OpenSequence(dir.path(), SequenceFormat::kFolder);
  EXPECT_DOUBLE_EQ(with_camera.frames[3].time_s, 0.3);
  EXPECT_EQ(with_camera.camera.value().params, (std::vector<double>{30, 31, 16, 12}));
}

TEST(FolderSequence, FrameRangeKeepsNumbersAndTimes) {
  const TempDir dir;
  for (int i = 0; i < 10; ++i) dir.Write(fmt::format("{}.png", i), EncodedImage(i));
  const ImageSequence sequence = OpenSequence(dir.path(), SequenceFormat::kFolder, {2, 9, 3});
  EXPECT_THAT(Names(sequence), ElementsAre("2.png", "5.png", "8.png"));
  EXPECT_EQ(sequence.frames[2].index, 8);
  EXPECT_DOUBLE_EQ(sequence.frames[2].time_s, 8.0 / 30.0);
  EXPECT_EQ(OpenSequence(dir.path(), SequenceFormat::kFolder, {0, 99, 1}).frames.size(), 10u);
  EXPECT_THROW(OpenSequence(dir.path(), SequenceFormat::kFolder, {10, -1, 1}), InputError);
  EXPECT_THROW(OpenSequence(dir.path(), SequenceFormat::kFolder, {5, 5, 1}), InputError);
}

TEST(FolderSequence, WhatHoldsNoImagesIsRefused) {
  const TempDir dir;
  ExpectError(dir.path(), SequenceFormat::kAuto, "no images");
  ExpectError(dir / "absent", SequenceFormat::kAuto, "no such file");
  const auto image = dir.Write("one.png", EncodedImage(1));
  ExpectError(image, SequenceFormat::kAuto, "single image");
  ExpectError(image, SequenceFormat::kFolder, "not a directory");
}

TEST(TumSequence, ListsWhatRgbTxtNames) {
  const TempDir dir;
  dir.Write("rgb/1.5.png", EncodedImage(1));
  dir.Write("rgb/1.6.png", EncodedImage(2));
  dir.Write("rgb/not listed.png", EncodedImage(2));
  dir.Write("rgb.txt", "# color images\n# timestamp filename\n1.5 rgb/1.5.png\n1.6 rgb/1.6.png\n");
  const ImageSequence sequence = OpenSequence(dir.path(), SequenceFormat::kAuto);
  EXPECT_EQ(sequence.format, SequenceFormat::kTum);
  EXPECT_EQ(sequence.image_root, dir / "rgb");
  EXPECT_THAT(Names(sequence), ElementsAre("1.5.png", "1.6.png"));
  EXPECT_THAT(Times(sequence), ElementsAre(1.5, 1.6));
  EXPECT_FALSE(sequence.camera.has_value());
  dir.Write("camera.json", kCameraJson);
  EXPECT_TRUE(OpenSequence(dir.path(), SequenceFormat::kTum).camera.has_value());
}

TEST(TumSequence, FaultsAreNamed) {
  const TempDir dir;
  dir.Write("rgb/1.png", EncodedImage(1));
  dir.Write("rgb/2.png", EncodedImage(1));
  const auto expect_error = [&](const std::string& list, const std::string& message) {
    dir.Write("rgb.txt", list);
    ExpectError(dir.path(), SequenceFormat::kTum, message);
  };
  expect_error("", "lists no images");
  expect_error("1.0\n", "rgb.txt: line 1: image path is missing");
  expect_error("x rgb/1.png\n", "line 1: timestamp");
  expect_error("1 rgb/1.png\n1 rgb/2.png\n", "not after");
  expect_error("1 rgb/1.png\n2 rgb/1.png\n", "listed twice");
  expect_error("1 rgb/1.png\n2 rgb/3.png\n", "rgb/3.png: no such image");
  std::filesystem::remove(dir / "rgb.txt");
  ExpectError(dir.path(), SequenceFormat::kTum, "rgb.txt");
}

constexpr const char* kKittiCalibration =
    "P0: 7.0e+02 0 6.0e+02 0 0 7.1e+02 1.8e+02 0 0 0 1 0\n"
    "P1: 7.0e+02 0 6.0e+02 -3 0 7.0e+02 1.8e+02 0 0 0 1 0\n";

TEST(KittiSequence, BringsItsCamera) {
  for (const char* extension : {".png", ".jpg"}) {
    const TempDir dir;
    for (int i = 0; i < 3; ++i) {
      dir.Write(fmt::format("image_0/{:06d}{}", i, extension), EncodedImage(i, extension));
    }
    dir.Write("times.txt", "0.0e+00\n1.0e-01\n2.5e-01\n");
    dir.Write("calib.txt", kKittiCalibration);
    const ImageSequence sequence = OpenSequence(dir.path(), SequenceFormat::kAuto);
    EXPECT_EQ(sequence.format, SequenceFormat::kKitti);
    EXPECT_EQ(sequence.image_root, dir / "image_0");
    EXPECT_EQ(sequence.frames[1].name, fmt::format("000001{}", extension));
    EXPECT_THAT(Times(sequence), ElementsAre(0.0, 0.1, 0.25));
    EXPECT_EQ(sequence.camera.value().params, (std::vector<double>{700, 710, 600.5, 180.5}));
    EXPECT_EQ(sequence.camera->width, 32);
    EXPECT_EQ(sequence.camera->height, 24);
    dir.Write("camera.json", kCameraJson);
    EXPECT_EQ(OpenSequence(dir.path(), SequenceFormat::kAuto).camera->params[0], 30.0);
  }
}

TEST(KittiSequence, TimesOfAPartAreFoundByNumber) {
  const TempDir dir;
  dir.Write("image_2/000002.png", EncodedImage(2));
  dir.Write("image_2/000003.png", EncodedImage(3));
  dir.Write("times.txt", "0\n1\n2\n3\n4\n");
  dir.Write("calib.txt", std::string(kKittiCalibration));
  ExpectError(dir.path(), SequenceFormat::kKitti, "P2 is missing");
  dir.Write("calib.txt", std::string("P2: 5 0 6 0 0 5 7 0 0 0 1 0\n"));
  const ImageSequence sequence = OpenSequence(dir.path(), SequenceFormat::kKitti);
  EXPECT_THAT(Times(sequence), ElementsAre(2.0, 3.0));
  EXPECT_EQ(sequence.camera->params[0], 5.0);
  dir.Write("times.txt", "0\n1\n2\n");
  ExpectError(dir.path(), SequenceFormat::kKitti, "no time for 000003.png");
  dir.Write("times.txt", "0\n1\n2\nx\n");
  ExpectError(dir.path(), SequenceFormat::kKitti, "times.txt: line 4");
}

TEST(KittiSequence, FoldersOfPhotosThatLookAlikeAreAFolder) {
  const TempDir dir;
  dir.Write("image_0/a.png", EncodedImage(0));
  dir.Write("image_1/a.png", EncodedImage(1));
  const ImageSequence sequence = OpenSequence(dir.path(), SequenceFormat::kAuto);
  EXPECT_EQ(sequence.format, SequenceFormat::kFolder);
  EXPECT_THAT(Names(sequence), ElementsAre("image_0/a.png", "image_1/a.png"));
  ExpectError(dir.path(), SequenceFormat::kKitti, "times.txt");
}

TEST(KittiRawSequence, FindsTheCalibrationOneLevelUp) {
  const TempDir dir;
  const std::string drive = "2011_09_26/drive_0011_sync/";
  dir.Write(drive + "image_00/data/0000000000.png", EncodedImage(0));
  dir.Write(drive + "image_00/data/0000000001.png", EncodedImage(1));
  dir.Write(drive + "image_00/timestamps.txt",
            "2011-09-26 23:59:59.750000000\n2011-09-27 00:00:00.250000000\n");
  dir.Write("2011_09_26/calib_cam_to_cam.txt",
            "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.95e-02\n"
            "P_rect_00: 7.0e+02 0 6.0e+02 0 0 7.1e+02 1.8e+02 0 0 0 1 0\n");
  const ImageSequence sequence = OpenSequence(dir / drive, SequenceFormat::kAuto);
  EXPECT_EQ(sequence.format, SequenceFormat::kKittiRaw);
  EXPECT_THAT(Names(sequence), ElementsAre("0000000000.png", "0000000001.png"));
  EXPECT_DOUBLE_EQ(sequence.frames[0].time_s, 1317081599.75);
  EXPECT_NEAR(sequence.frames[1].time_s - sequence.frames[0].time_s, 0.5, 1e-6);
  EXPECT_EQ(sequence.camera.value().params, (std::vector<double>{700, 710, 600.5, 180.5}));
  dir.Write(drive + "image_00/timestamps.txt", "2011-13-26 23:59:59\n2011-09-27 00:00:00\n");
  ExpectError(dir / drive, SequenceFormat::kKittiRaw, "line 1: not a date");
}

constexpr const char* kSensorYaml =
    "# sensor\nsensor_type: camera\nT_BS:\n  cols: 4\n  data: [0.0, 1.0,\n    2.0, 3.0]\n"
    "resolution: [32, 24]\ncamera_model: pinhole\n"
    "intrinsics: [45.5, 46.5,\n   15.0, 11.0] #fu, fv, cu, cv\n"
    "distortion_model: radial-tangential # the usual\n"
    "distortion_coefficients: [-0.25, 0.125, 0.5, 1.0e-1]\n";

void WriteEuroc(const TempDir& dir, const std::string& yaml) {
  dir.Write("mav0/cam0/data/1403638538577829376.png", EncodedImage(1));
  dir.Write("mav0/cam0/data/1403638538627829504.png", EncodedImage(2));
  dir.Write("mav0/cam0/data.csv",
            "#timestamp [ns],filename\r\n1403638538577829376,1403638538577829376.png\r\n"
            "1403638538627829504, 1403638538627829504.png\r\n");
  dir.Write("mav0/cam0/sensor.yaml", yaml);
}

TEST(EurocSequence, BringsItsCamera) {
  const TempDir dir;
  WriteEuroc(dir, kSensorYaml);
  for (const char* below : {"", "mav0", "mav0/cam0"}) {
    const ImageSequence sequence = OpenSequence(dir / below, SequenceFormat::kAuto);
    EXPECT_EQ(sequence.format, SequenceFormat::kEuroc);
    EXPECT_THAT(Names(sequence), ElementsAre("1403638538577829376.png", "1403638538627829504.png"));
    EXPECT_DOUBLE_EQ(sequence.frames[0].time_s, 1403638538.577829376);
    const Camera& camera = sequence.camera.value();
    EXPECT_EQ(camera.model, CameraModel::kOpenCv);
    EXPECT_EQ(camera.params, (std::vector<double>{45.5, 46.5, 15.5, 11.5, -0.25, 0.125, 0.5, 0.1}));
  }
}

TEST(EurocSequence, OtherDistortionsAndFaults) {
  const TempDir dir;
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string yaml = kSensorYaml;
    yaml.replace(yaml.find(from), from.size(), to);
    WriteEuroc(dir, yaml);
  };
  with("radial-tangential", "equidistant");
  EXPECT_EQ(OpenSequence(dir.path(), SequenceFormat::kEuroc).camera->model,
            CameraModel::kOpenCvFisheye);
  with("radial-tangential", "none");
  EXPECT_EQ(OpenSequence(dir.path(), SequenceFormat::kEuroc).camera->params.size(), 4u);
  with("radial-tangential", "\"radial-tangential\"");
  EXPECT_EQ(OpenSequence(dir.path(), SequenceFormat::kEuroc).camera->model, CameraModel::kOpenCv);
  with("radial-tangential", "omni");
  ExpectError(dir.path(), SequenceFormat::kEuroc, "'omni' is not supported");
  with("intrinsics:", "intrinsic:");
  ExpectError(dir.path(), SequenceFormat::kEuroc, "sensor.yaml: intrinsics is missing");
  with("[45.5, 46.5,", "[45.5,");
  ExpectError(dir.path(), SequenceFormat::kEuroc, "intrinsics has 3 numbers, expected 4");
  for (const char* size : {"[32, x]", "[32, 1e300]", "[0, 24]", "[32.5, 24]", "[32]"}) {
    with("[32, 24]", size);
    ExpectError(dir.path(), SequenceFormat::kEuroc, "resolution");
  }
  WriteEuroc(dir, kSensorYaml);
  dir.Write("mav0/cam0/data.csv", "1403638538577829376 a.png\n");
  ExpectError(dir.path(), SequenceFormat::kEuroc, "data.csv: line 1");
}

TEST(ImageSequence, ACameraThatIsNotWantedIsNotRead) {
  const TempDir dir;
  WriteEuroc(dir, "distortion_model: omni\n");
  const auto open = [&](SequenceFormat format) {
    return OpenSequence(dir.path(), format, {}, OwnCamera::kIgnored);
  };
  EXPECT_FALSE(open(SequenceFormat::kEuroc).camera.has_value());
  dir.Write("image_0/000000.png", EncodedImage(0));
  dir.Write("times.txt", "0\n");
  dir.Write("calib.txt", "P1: nothing\n");
  EXPECT_FALSE(open(SequenceFormat::kKitti).camera.has_value());
  dir.Write("camera.json", kCameraJson);
  EXPECT_FALSE(open(SequenceFormat::kKitti).camera.has_value());
  EXPECT_TRUE(OpenSequence(dir.path(), SequenceFormat::kFolder).camera.has_value());
}

TEST(ImageSequence, TimesMustIncreaseAmongTheFramesThatAreTaken) {
  const TempDir dir;
  for (int i = 0; i < 4; ++i) dir.Write(fmt::format("rgb/{}.png", i), EncodedImage(i));
  dir.Write("rgb.txt", "1 rgb/0.png\n2 rgb/1.png\n2 rgb/2.png\n3 rgb/3.png\n");
  ExpectError(dir.path(), SequenceFormat::kTum, "2.png (2 s) is not after");
  EXPECT_THAT(Times(OpenSequence(dir.path(), SequenceFormat::kTum, {0, 2, 1})),
              ElementsAre(1.0, 2.0));
  EXPECT_THAT(Times(OpenSequence(dir.path(), SequenceFormat::kTum, {0, -1, 2})),
              ElementsAre(1.0, 2.0));
}

/// 25 Hz, gray values growing by `step`; false if this OpenCV cannot write it.
bool WriteVideo(int num_frames, int step, const std::filesystem::path& path) {
  cv::VideoWriter writer(path.string(), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 25.0,
                         cv::Size(32, 24));
  if (!writer.isOpened()) return false;
  for (int i = 0; i < num_frames; ++i) {
    writer.write(cv::Mat(24, 32, CV_8UC3, cv::Scalar::all(step * i)));
  }
  return true;
}

TEST(VideoSequence, FramesAreReadInAnyOrder) {
  const TempDir dir;
  const auto path = dir / "clip.avi";
  if (!WriteVideo(12, 20, path)) GTEST_SKIP() << "this OpenCV cannot write a video";
  dir.Write("camera.json", kCameraJson);
  const ImageSequence sequence = OpenSequence(path, SequenceFormat::kAuto, {1, -1, 2});
  EXPECT_EQ(sequence.format, SequenceFormat::kVideo);
  ASSERT_EQ(sequence.frames.size(), 6u);
  EXPECT_EQ(sequence.frames[1].name, "clip_000003.png");
  EXPECT_NEAR(sequence.frames[1].time_s - sequence.frames[0].time_s, 2.0 / 25.0, 1e-6);
  EXPECT_TRUE(sequence.camera.has_value());
  const FrameReader reader(sequence);
  EXPECT_FALSE(reader.IsThreadSafe());
  for (const size_t i : {size_t{0}, size_t{3}, size_t{5}, size_t{1}, size_t{1}, size_t{4}}) {
    EXPECT_NEAR(reader.Read(i).at<cv::Vec3b>(12, 16)[1], 20 * sequence.frames[i].index, 4) << i;
    EXPECT_EQ(reader.ReadGray(i).type(), CV_8UC1);
  }
}

TEST(VideoSequence, OneThatIsCutShortIsWarnedOf) {
  const TempDir dir;
  const auto path = dir / "clip.avi";
  if (!WriteVideo(40, 6, path)) GTEST_SKIP() << "this OpenCV cannot write a video";
  const testing::CapturedLog whole;
  EXPECT_EQ(OpenSequence(path, SequenceFormat::kVideo).frames.size(), 40u);
  EXPECT_EQ(whole.text(), "");
  std::filesystem::resize_file(path, std::filesystem::file_size(path) / 2);
  const testing::CapturedLog cut;
  EXPECT_LT(OpenSequence(path, SequenceFormat::kVideo).frames.size(), 30u);
  EXPECT_THAT(cut.text(), HasSubstr("announces 40 frames"));
}

TEST(VideoSequence, WhatIsNoVideoIsRefused) {
  const TempDir dir;
  ExpectError(dir.Write("clip.mp4", "not a video"), SequenceFormat::kAuto, "clip.mp4");
  ExpectError(dir.path(), SequenceFormat::kVideo, "not a video file");
}

TEST(FrameReader, ReadsColourAndGrayAndNamesBadImages) {
  const TempDir dir;
  dir.Write("0.png", EncodedImage(1, ".png", CV_8UC3));
  dir.Write("1.jpg", EncodedImage(2, ".jpg", CV_8UC1));
  dir.Write("2.png", EncodedImage(3).substr(0, 40));
  std::vector<uchar> deep;
  cv::imencode(".png", cv::Mat(24, 32, CV_16UC1, cv::Scalar(0x7fff)), deep);
  dir.Write("3.png", std::string(deep.begin(), deep.end()));
  const ImageSequence sequence = OpenSequence(dir.path(), SequenceFormat::kFolder);
  const FrameReader reader(sequence);
  EXPECT_TRUE(reader.IsThreadSafe());
  EXPECT_EQ(reader.Read(0).type(), CV_8UC3);
  EXPECT_EQ(reader.ReadGray(0).type(), CV_8UC1);
  EXPECT_EQ(reader.ReadGray(0).at<uint8_t>(3, 3), 10);
  EXPECT_EQ(reader.Read(1).type(), CV_8UC1);
  EXPECT_THAT([&] { (void)reader.Read(2); }, ThrowsMessage<InputError>(HasSubstr("2.png")));
  EXPECT_EQ(reader.Read(3).type(), CV_8UC1);
  EXPECT_EQ(reader.Read(3).at<uint8_t>(3, 3), 0x7f);
}

/// A sequence of 16-bit images, each of one value.
std::string EncodedDeepImage(int value, int type = CV_16UC1) {
  std::vector<uchar> bytes;
  cv::imencode(".png", cv::Mat(24, 32, type, cv::Scalar::all(value)), bytes);
  return {bytes.begin(), bytes.end()};
}

TEST(FrameReader, BitsThatASensorDoesNotHaveAreNotMissed) {
  for (const auto& [bits, largest] : {std::pair(8, 200), std::pair(10, 1000), std::pair(12, 4000),
                                      std::pair(14, 9000), std::pair(16, 60000)}) {
    const TempDir dir;
    for (int i = 0; i < 20; ++i) {
      dir.Write(fmt::format("{:02}.png", i),
                EncodedDeepImage(i < 10 ? largest / 4 : largest, i < 15 ? CV_16UC1 : CV_16UC3));
    }
    const FrameReader reader(OpenSequence(dir.path(), SequenceFormat::kFolder));
    const double scale = std::exp2(8 - bits);
    EXPECT_EQ(reader.ReadGray(1).at<uint8_t>(3, 3), static_cast<int>(scale * (largest / 4)));
    EXPECT_EQ(reader.ReadGray(12).at<uint8_t>(3, 3), static_cast<int>(scale * largest));
    EXPECT_EQ(reader.Read(17).type(), CV_8UC3);
    EXPECT_EQ(reader.Read(17).at<cv::Vec3b>(3, 3)[1], static_cast<int>(scale * largest));
  }
}

TEST(LeaveOutUnusable, NamesWhatIsWrongWithImagesThatAreLeftOut) {
  const TempDir dir;
  for (const char* good : {"1.png", "3.png", "5.png"}) dir.Write(good, EncodedImage(1));
  dir.Write("0.png", EncodedImage(1).substr(0, 40));
  std::vector<uchar> large;
  cv::imencode(".png", cv::Mat(48, 64, CV_8UC1, cv::Scalar(7)), large);
  dir.Write("4.png", std::string(large.begin(), large.end()));
  dir.Write("rgb.txt", "0 0.png\n1 1.png\n2 2.png\n3 3.png\n4 4.png\n5 5.png\n");
  ExpectError(dir.path(), SequenceFormat::kTum, "2.png: no such image");
  const auto open = [&] {
    return OpenSequence(dir.path(), SequenceFormat::kTum, {}, OwnCamera::kRead,
                        MissingImages::kKept);
  };
  for (const bool has_camera : {false, true}) {
    if (has_camera) dir.Write("camera.json", kCameraJson);
    ImageSequence sequence = open();
    EXPECT_THAT(LeaveOutUnusable(2, sequence),
                ElementsAre(HasSubstr("0.png"), HasSubstr("2.png"),
                            AllOf(HasSubstr("4.png"), HasSubstr("64 x 48"))));
    EXPECT_THAT(Names(sequence), ElementsAre("1.png", "3.png", "5.png"));
    EXPECT_EQ(sequence.frames[1].index, 3);
    EXPECT_THAT(LeaveOutUnusable(2, sequence), ElementsAre());
  }
}

TEST(LeaveOutUnusable, WithoutACameraTheMostFrequentSizeCounts) {
  const TempDir dir;
  std::vector<uchar> small;
  cv::imencode(".png", cv::Mat(6, 8, CV_8UC1, cv::Scalar(7)), small);
  const std::string thumbnail(small.begin(), small.end());
  dir.Write("0.png", thumbnail);
  dir.Write("1.png", EncodedImage(1));
  ImageSequence as_many = OpenSequence(dir.path(), SequenceFormat::kFolder);
  LeaveOutUnusable(2, as_many);
  EXPECT_THAT(Names(as_many), ElementsAre("0.png"));
  dir.Write("2.png", EncodedImage(1));
  ImageSequence fewer = OpenSequence(dir.path(), SequenceFormat::kFolder);
  EXPECT_THAT(LeaveOutUnusable(2, fewer),
              ElementsAre(AllOf(HasSubstr("0.png"), HasSubstr("8 x 6"), HasSubstr("32 x 24"))));
  EXPECT_THAT(Names(fewer), ElementsAre("1.png", "2.png"));
}

TEST(LeaveOutUnusable, WhereNoImageIsLeftTheFirstSaysWhy) {
  const TempDir dir;
  for (const char* bad : {"0.png", "1.png"}) dir.Write(bad, EncodedImage(1).substr(0, 40));
  ImageSequence sequence = OpenSequence(dir.path(), SequenceFormat::kFolder);
  EXPECT_THAT([&] { LeaveOutUnusable(2, sequence); },
              ThrowsMessage<InputError>(HasSubstr("0.png")));
}

TEST(FrameReader, AnImageOfAnotherSizeThanTheCameraIsRefused) {
  const TempDir dir;
  dir.Write("0.png", EncodedImage(1));
  ImageSequence sequence = OpenSequence(dir.path(), SequenceFormat::kFolder);
  sequence.camera = Camera{CameraId(1), CameraModel::kSimplePinhole, 64, 48, {50, 32, 24}};
  EXPECT_THAT([&] { (void)FrameReader(sequence).Read(0); },
              ThrowsMessage<InputError>(AllOf(HasSubstr("32 x 24"), HasSubstr("64 x 48"))));
}

}  // namespace
}  // namespace s3lam
