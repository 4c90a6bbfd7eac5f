#include "s3lam/io/colmap_model.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <sstream>

#include "s3lam/base/error.h"
#include "support/captured_log.h"
#include "support/temp_dir.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using testing::FileBytes;
using ::testing::HasSubstr;
using testing::Identical;
using testing::MakeTestScene;
using testing::TempDir;
using ::testing::ThrowsMessage;

/// All camera models, an image without keypoints, a name with a blank, a track-less number format.
Reconstruction RichModel() {
  Reconstruction model = MakeTestScene({.num_images = 5, .num_points = 30, .num_cameras = 2});
  for (int i = 0; i < kNumCameraModels; ++i) {
    const CameraId id(static_cast<uint32_t>(100 + i));
    model.cameras[id] = testing::MakeTestCamera(static_cast<CameraModel>(i), id);
  }
  Image& empty = model.images[ImageId(1000)];
  empty.id = ImageId(1000);
  empty.camera_id = CameraId(103);
  empty.name = "sub/folder/without keypoints.jpg";
  empty.cam_from_world = model.images.begin()->second.cam_from_world;
  return model;
}

struct Format {
  const char* name;
  void (*write_file)(const Reconstruction&, const std::filesystem::path&);
  struct Part {
    const char* file;
    void (*read)(std::istream&, const std::string&, Reconstruction&);
    void (*write)(const Reconstruction&, std::ostream&);
  };
  Part parts[3];
};

const Format kFormats[] = {{"binary",
                            WriteColmapModel,
                            {{"cameras.bin", ReadCamerasBinary, WriteCamerasBinary},
                             {"images.bin", ReadImagesBinary, WriteImagesBinary},
                             {"points3D.bin", ReadPointsBinary, WritePointsBinary}}},
                           {"text",
                            WriteColmapModelText,
                            {{"cameras.txt", ReadCamerasText, WriteCamerasText},
                             {"images.txt", ReadImagesText, WriteImagesText},
                             {"points3D.txt", ReadPointsText, WritePointsText}}}};

class ColmapModelFormat : public ::testing::TestWithParam<Format> {};

TEST_P(ColmapModelFormat, StreamRoundTripIsExact) {
  const Reconstruction model = RichModel();
  Reconstruction read;
  for (const Format::Part& part : GetParam().parts) {
    std::stringstream stream;
    part.write(model, stream);
    part.read(stream, part.file, read);
  }
  EXPECT_TRUE(Identical(model, read));
}

TEST_P(ColmapModelFormat, FileRoundTripIsExact) {
  const Reconstruction model = RichModel();
  const TempDir dir;
  EXPECT_FALSE(IsColmapModel(dir.path()));
  GetParam().write_file(model, dir.path());
  EXPECT_TRUE(IsColmapModel(dir.path()));
  EXPECT_TRUE(Identical(model, ReadColmapModel(dir.path())));
}

/// Reads the three parts, part `cut_part` without its end, and checks the result as
/// ReadColmapModel does.
void ReadCut(const Format& format, const std::array<std::string, 3>& contents, size_t cut_part,
             size_t size) {
  Reconstruction read;
  for (size_t i = 0; i < contents.size(); ++i) {
    std::istringstream stream(i == cut_part ? contents[i].substr(0, size) : contents[i]);
    format.parts[i].read(stream, format.parts[i].file, read);
  }
  CheckReconstruction(read, "model");
}

TEST_P(ColmapModelFormat, EveryTruncationIsAnError) {
  const Reconstruction model = MakeTestScene({.num_images = 3, .num_points = 4});
  const Format& format = GetParam();
  std::array<std::string, 3> contents;
  for (size_t i = 0; i < contents.size(); ++i) {
    std::ostringstream stream;
    format.parts[i].write(model, stream);
    contents[i] = stream.str();
  }
  for (size_t i = 0; i < contents.size(); ++i) {
    EXPECT_NO_THROW(ReadCut(format, contents, i, contents[i].size()));
    for (size_t size = 0; size < contents[i].size(); ++size) {
      EXPECT_THROW(ReadCut(format, contents, i, size), InputError)
          << format.parts[i].file << " cut to " << size;
    }
  }
}

TEST_P(ColmapModelFormat, EveryMissingFileIsNamed) {
  for (const Format::Part& part : GetParam().parts) {
    const TempDir dir;
    GetParam().write_file(RichModel(), dir.path());
    std::filesystem::remove(dir / part.file);
    EXPECT_THAT([&] { ReadColmapModel(dir.path()); },
                ThrowsMessage<InputError>(HasSubstr(part.file)));
  }
}

TEST_P(ColmapModelFormat, RepeatedIdsAreRefused) {
  const Reconstruction model = RichModel();
  for (const Format::Part& part : GetParam().parts) {
    Reconstruction read;
    std::stringstream first, second;
    part.write(model, first);
    part.write(model, second);
    part.read(first, part.file, read);
    EXPECT_THAT([&] { part.read(second, part.file, read); },
                ThrowsMessage<InputError>(AllOf(HasSubstr(part.file), HasSubstr("twice"))));
  }
}

TEST_P(ColmapModelFormat, NumbersThatAreNotFiniteAreRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto expect_refused = [&](const Reconstruction& model, size_t part_index) {
    const Format::Part& part = GetParam().parts[part_index];
    std::stringstream stream;
    part.write(model, stream);
    Reconstruction read;
    EXPECT_THAT([&] { part.read(stream, part.file, read); },
                ThrowsMessage<InputError>(AllOf(HasSubstr(part.file), HasSubstr("finite"))));
  };
  Reconstruction model = RichModel();
  model.cameras.begin()->second.params[2] = std::numeric_limits<double>::infinity();
  expect_refused(model, 0);
  model = RichModel();
  model.images.begin()->second.cam_from_world.rotation.z() = nan;
  expect_refused(model, 1);
  model = RichModel();
  model.images.begin()->second.points2D[1].xy.y() = nan;
  expect_refused(model, 1);
  model = RichModel();
  model.points.begin()->second.xyz.y() = nan;
  expect_refused(model, 2);
  model = RichModel();
  model.points.begin()->second.error = nan;
  expect_refused(model, 2);
}

INSTANTIATE_TEST_SUITE_P(Formats, ColmapModelFormat, ::testing::ValuesIn(kFormats),
                         [](const auto& format) { return std::string(format.param.name); });

template <typename Read>
void ExpectError(Read read, const std::string& content, const std::string& message) {
  std::istringstream stream(content);
  Reconstruction model;
  EXPECT_THAT([&] { read(stream, "the file", model); },
              ThrowsMessage<InputError>(AllOf(HasSubstr("the file"), HasSubstr(message))))
      << content;
}

std::string Bytes(const auto& value) {
  return {reinterpret_cast<const char*>(&value), sizeof(value)};
}

TEST(ColmapModelBinary, CountsAreHeldAgainstTheSizeOfTheFile) {
  // None of these may try to allocate what it claims.
  const uint64_t huge = std::numeric_limits<uint64_t>::max() / 2;
  ExpectError(ReadCamerasBinary, Bytes(huge), "claims");
  ExpectError(ReadImagesBinary, Bytes(huge), "claims");
  ExpectError(ReadPointsBinary, Bytes(huge), "claims");
  const Reconstruction model = MakeTestScene({.num_images = 2, .num_points = 5});
  std::ostringstream images, points;
  WriteImagesBinary(model, images);
  WritePointsBinary(model, points);
  std::string bytes = images.str();
  const size_t name_end = bytes.find('\0', bytes.find("part0/")) + 1;
  bytes.replace(name_end, 8, Bytes(huge));
  ExpectError(ReadImagesBinary, bytes, "keypoints");
  bytes = points.str();
  bytes.replace(8 + 8 + 24 + 3 + 8, 8, Bytes(huge));
  ExpectError(ReadPointsBinary, bytes, "track elements");
}

TEST(ColmapModelBinary, BytesAfterTheLastEntryAreRefused) {
  std::ostringstream stream;
  WriteCamerasBinary(RichModel(), stream);
  ExpectError(ReadCamerasBinary, stream.str() + "x", "1 bytes after");
}

TEST(ColmapModelBinary, UnsupportedCameraModelIsNamed) {
  const std::string bytes = Bytes(uint64_t{1}) + Bytes(uint32_t{5}) + Bytes(int32_t{10}) +
                            Bytes(uint64_t{640}) + Bytes(uint64_t{480}) + std::string(64, '\0');
  ExpectError(ReadCamerasBinary, bytes, "unsupported camera model id 10");
  ExpectError(ReadCamerasBinary, bytes, "SIMPLE_RADIAL_FISHEYE");  // As one that is supported.
}

/// Adds a camera of a model that is not supported to the files of a model, in both forms.
void AddOtherCamera(const TempDir& dir, uint32_t id) {
  std::string bytes = FileBytes(dir / "binary/cameras.bin");
  bytes.replace(0, 8, Bytes(uint64_t{2}));
  bytes += Bytes(id) + Bytes(int32_t{10}) + Bytes(uint64_t{640}) + Bytes(uint64_t{480}) +
           std::string(12 * sizeof(double), '\0');
  dir.Write("binary/cameras.bin", bytes);
  std::string text = FileBytes(dir / "text/cameras.txt");
  const std::string count = "cameras: 1";
  text.replace(text.find(count), count.size(), "cameras: 2");
  text += fmt::format("{} THIN_PRISM_FISHEYE 640 480 1 1 2 2 0 0 0 0 0 0 0 0\n", id);
  dir.Write("text/cameras.txt", text);
}

TEST(ColmapModel, CamerasOfOtherModelsMayBeThereUnused) {
  const Reconstruction scene = MakeTestScene();
  const TempDir dir;
  for (const Format& format : kFormats) {
    std::filesystem::create_directories(dir / format.name);
    format.write_file(scene, dir / format.name);
  }
  const uint32_t used = scene.cameras.begin()->first.value();
  AddOtherCamera(dir, used + 1);
  for (const Format& format : kFormats) {
    const testing::CapturedLog log;
    EXPECT_TRUE(Identical(ReadColmapModel(dir / format.name), scene)) << format.name;
    EXPECT_THAT(log.text(), HasSubstr(fmt::format("camera {} is left out", used + 1)));
    EXPECT_THAT(log.text(), HasSubstr("THIN_PRISM_FISHEYE"));
  }
}

TEST(ColmapModel, CamerasOfOtherModelsAreRefusedIfUsed) {
  Reconstruction scene = MakeTestScene();
  const uint32_t used = scene.cameras.begin()->first.value();
  scene.images.begin()->second.camera_id = CameraId(used + 1);
  const TempDir dir;
  for (const Format& format : kFormats) {
    std::filesystem::create_directories(dir / format.name);
    format.write_file(scene, dir / format.name);
  }
  AddOtherCamera(dir, used + 1);
  for (const Format& format : kFormats) {
    EXPECT_THAT([&] { ReadColmapModel(dir / format.name); },
                ThrowsMessage<InputError>(
                    AllOf(HasSubstr("unsupported camera model"), HasSubstr("RADIAL_FISHEYE"))));
  }
}

TEST(ColmapModelBinary, LayoutIsColmaps) {
  Reconstruction model;
  model.cameras[CameraId(3)] = {
      CameraId(3), CameraModel::kSimplePinhole, 640, 480, {500, 320, 240}};
  std::ostringstream stream;
  WriteCamerasBinary(model, stream);
  EXPECT_EQ(stream.str(), Bytes(uint64_t{1}) + Bytes(uint32_t{3}) + Bytes(int32_t{0}) +
                              Bytes(uint64_t{640}) + Bytes(uint64_t{480}) + Bytes(500.0) +
                              Bytes(320.0) + Bytes(240.0));
  model.images[ImageId(7)] = {ImageId(7), CameraId(3), "a", {}, {{{1.5, 2.5}, kInvalidPointId}}};
  stream.str("");
  WriteImagesBinary(model, stream);
  EXPECT_EQ(stream.str(), Bytes(uint64_t{1}) + Bytes(uint32_t{7}) + Bytes(1.0) + Bytes(0.0) +
                              Bytes(0.0) + Bytes(0.0) + Bytes(0.0) + Bytes(0.0) + Bytes(0.0) +
                              Bytes(uint32_t{3}) + std::string("a\0", 2) + Bytes(uint64_t{1}) +
                              Bytes(1.5) + Bytes(2.5) + Bytes(~uint64_t{0}));
}

TEST(ColmapModelText, HandWrittenFilesAreRead) {
  Reconstruction model;
  std::istringstream cameras(
      "\n  # my camera\r\n1 SIMPLE_RADIAL 640 480 +500 320. 2.4e2 -0.05\r\n");
  ReadCamerasText(cameras, "cameras.txt", model);
  // The second image has no keypoints; its line of keypoints is empty but there.
  std::istringstream images(
      "# comment\n1 1 0 0 0 0 0 0 1 a b.png\n10 20 -1 30 40 8\n\n"
      "2 1 0 0 0 0 0 1 1 sub/c.png\n\n"
      "3 1 0 0 0 0 0 2 1 d.png\n11 21 8\n");
  ReadImagesText(images, "images.txt", model);
  std::istringstream points("8 0.5 0.25 4 255 0 1 -1 1 1 3 0");  // No newline at the end.
  ReadPointsText(points, "points3D.txt", model);
  CheckReconstruction(model, "model");
  EXPECT_EQ(model.cameras.at(CameraId(1)).params, (std::vector<double>{500, 320, 240, -0.05}));
  ASSERT_EQ(model.images.size(), 3u);
  EXPECT_EQ(model.images.at(ImageId(1)).name, "a b.png");
  EXPECT_FALSE(model.images.at(ImageId(1)).points2D[0].point_id.valid());
  EXPECT_EQ(model.images.at(ImageId(1)).points2D[1].point_id, PointId(8));
  EXPECT_TRUE(model.images.at(ImageId(2)).points2D.empty());
  EXPECT_EQ(model.images.at(ImageId(3)).points2D.size(), 1u);
  EXPECT_EQ(model.points.at(PointId(8)).color, (Rgb{255, 0, 1}));
}

TEST(ColmapModelText, MalformedLinesAreNamed) {
  ExpectError(ReadCamerasText, "# c\n1 PINHOLE 640 480 1 2 3\n", "line 2: camera parameter");
  ExpectError(ReadCamerasText, "1 PINHOLE 640 480 1 2 3 4 5\n", "unexpected text");
  ExpectError(ReadCamerasText, "1 THIN_PRISM_FISHEYE 640 480 1\n", "'THIN_PRISM_FISHEYE'");
  ExpectError(ReadCamerasText, "1 PINHOLE 640.5 480 1 2 3 4\n", "width");
  ExpectError(ReadCamerasText, "1 PINHOLE 640 480 1 nan 3 4\n", "not finite");
  ExpectError(ReadCamerasText, "4294967295 PINHOLE 640 480 1 2 3 4\n", "invalid camera id");
  ExpectError(ReadImagesText, "1 1 0 0 0 0 0 0 1\n\n", "no name");
  ExpectError(ReadImagesText, "1 1 0 0 0 0 0 0 1 a\n1 2\n", "line 2: point id is missing");
  ExpectError(ReadImagesText, "1 1 0 0 0 0 0 0 1 a\n1 2 -2\n", "point id");
  ExpectError(ReadImagesText, "1 1 0 0 0 0 0 0 1 a\n", "cut short");
  ExpectError(ReadPointsText, "1 0 0 0 256 0 0 0\n", "colour");
  ExpectError(ReadPointsText, "1 0 0 0 0 0 0 0 7\n", "keypoint index");
  ExpectError(ReadPointsText, "-1 0 0 0 0 0 0 0\n", "point id");
}

TEST(ColmapModelText, FewerEntriesThanPromisedAreRefused) {
  ExpectError(ReadCamerasText, "# Number of cameras: 2\n1 PINHOLE 640 480 1 1 3 4\n", "cut short");
  ExpectError(ReadCamerasText, "# Number of cameras: 1\n1 PINHOLE 640 480 1 1 3 4", "cut short");
}

TEST(ColmapModel, BinaryWinsOverText) {
  const TempDir dir;
  const Reconstruction model = RichModel();
  WriteColmapModel(model, dir.path());
  WriteColmapModelText(MakeTestScene({.num_images = 3}), dir.path());
  EXPECT_TRUE(Identical(model, ReadColmapModel(dir.path())));
}

TEST(ColmapModel, ModelInASubfolderIsPointedOut) {
  const TempDir dir;
  EXPECT_THAT([&] { ReadColmapModel(dir / "absent"); },
              ThrowsMessage<InputError>(HasSubstr("no such directory")));
  EXPECT_THAT([&] { ReadColmapModel(dir.path()); },
              ThrowsMessage<InputError>(HasSubstr("not a COLMAP model")));
  std::filesystem::create_directories(dir / "sparse/0");
  WriteColmapModel(RichModel(), dir / "sparse/0");
  EXPECT_THAT([&] { ReadColmapModel(dir.path()); },
              ThrowsMessage<InputError>(HasSubstr("sparse/0 is")));
}

TEST(ColmapModel, FaultyReferencesAndEqualNamesAreRefused) {
  Reconstruction model = RichModel();
  model.points.begin()->second.track.pop_back();
  TempDir dir;
  WriteColmapModel(model, dir.path());
  EXPECT_THROW(ReadColmapModel(dir.path()), InputError);
  model = RichModel();
  model.images.begin()->second.name = model.images.rbegin()->second.name;
  WriteColmapModel(model, dir.path());
  EXPECT_THAT([&] { ReadColmapModel(dir.path()); },
              ThrowsMessage<InputError>(HasSubstr("without keypoints.jpg")));
}

TEST(ColmapModel, RoundedQuaternionsAreNormalised) {
  std::istringstream images("1 0.7071 0.7071 0 0 0 0 0 1 a\n\n");
  Reconstruction model;
  ReadImagesText(images, "images.txt", model);
  EXPECT_NEAR(model.images.at(ImageId(1)).cam_from_world.rotation.norm(), 1.0, 1e-15);
}

TEST(ColmapModel, ProjectNamesTheImages) {
  const TempDir dir;
  WriteColmapProject(dir / "images", dir / "project.ini");
  EXPECT_THAT(FileBytes(dir / "project.ini"), HasSubstr("image_path=" + (dir / "images").string()));
}

TEST(ColmapModel, ProjectMayNameImagesFromItsOwnFolder) {
  const TempDir dir;
  std::filesystem::create_directories(dir / "model");
  const auto project = dir.Write("model/project.ini", "image_path=../images\n");
  EXPECT_EQ(ReadColmapProject(project), "../images");  // There is none.
  std::filesystem::create_directories(dir / "images");
  EXPECT_EQ(ReadColmapProject(project), dir / "model/../images");
  const std::filesystem::path here = std::filesystem::relative(dir / "images");
  std::filesystem::create_directories(dir / "model" / here);
  dir.Write("model/project.ini", "image_path=" + here.string() + "\n");
  EXPECT_EQ(ReadColmapProject(project), here);  // Rather from the working directory.
}

}  // namespace
}  // namespace s3lam
