// Models that are read without complaint, and what s3-refine makes of them.

#include <cstring>
#include <nlohmann/json.hpp>

#include "pipeline/model_fixture.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

using nlohmann::json;
using testing::FileBytes;
using ::testing::HasSubstr;
using testing::kBadInput;
using testing::kDone;
using testing::kFailed;
using testing::RunTool;

class BadRefine : public testing::ModelTest {
 protected:
  [[nodiscard]] Reconstruction Read() const { return ReadColmapModel(model()); }
  void Write(const Reconstruction& reconstruction) const {
    WriteColmapModel(reconstruction, model());
  }

  /// Without the semantic map, which is of the unspoiled model.
  testing::ProgramResult RunPlain(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments{"--model", model().string(), "--output", output().string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunTool("s3-refine", arguments);
  }

  void ExpectPlainRefused(int exit_code, const std::vector<std::string>& parts,
                          const std::vector<std::string>& more = {}) {
    const auto result = RunPlain(more);
    EXPECT_EQ(result.exit_code, exit_code) << result.errors;
    for (const std::string& part : parts) EXPECT_THAT(result.errors, HasSubstr(part));
    EXPECT_FALSE(std::filesystem::exists(output()));
  }

  /// Takes images away until `count` are left, and what only they saw.
  void KeepImages(size_t count) const {
    Reconstruction reconstruction = Read();
    while (reconstruction.images.size() > count) {
      reconstruction.images.erase(std::prev(reconstruction.images.end()));
    }
    for (auto& [id, point] : reconstruction.points) {
      std::erase_if(point.track, [&](const TrackElement& element) {
        return !reconstruction.images.contains(element.image_id);
      });
    }
    Write(reconstruction);
  }

  [[nodiscard]] json Report() const { return ReadJson(output() / "report.json"); }
};

TEST_F(BadRefine, OneImage) {
  KeepImages(1);
  ExpectPlainRefused(kBadInput, {"cannot be adjusted", "1 images"});
}

TEST_F(BadRefine, TwoImagesAreEnough) {
  KeepImages(2);
  const auto result = RunPlain();
  EXPECT_EQ(result.exit_code, kDone) << result.errors;
  EXPECT_EQ(Report()["images_in_use"], 2);
}

TEST_F(BadRefine, NoPoints) {
  Reconstruction reconstruction = Read();
  reconstruction.points.clear();
  for (auto& [id, image] : reconstruction.images) {
    for (Point2D& seen : image.points2D) seen.point_id = kInvalidPointId;
  }
  Write(reconstruction);
  ExpectPlainRefused(kBadInput, {"cannot be adjusted", "0 points"});
}

TEST_F(BadRefine, NotANumber) {
  std::string bytes = FileBytes(model() / "points3D.bin");
  const double nan = std::nan("");
  std::memcpy(bytes.data() + 16, &nan, sizeof(nan));  // Count, id, x.
  inputs_.Write("model/points3D.bin", bytes);
  ExpectPlainRefused(kBadInput, {"points3D.bin"});
}

TEST_F(BadRefine, AllPointsBehindTheCameras) {
  Reconstruction reconstruction = Read();
  const Image& image = reconstruction.images.begin()->second;
  for (auto& [id, point] : reconstruction.points) {
    point.xyz = image.cam_from_world.Inverse() * Eigen::Vector3d(0.0, 0.0, -3.0);
  }
  for (auto& [id, other] : reconstruction.images) other.cam_from_world = image.cam_from_world;
  Write(reconstruction);
  ExpectPlainRefused(kBadInput, {"cannot be adjusted"});
}

TEST_F(BadRefine, ZeroLengthTracksAndUnusedCameras) {
  Reconstruction reconstruction = Read();
  reconstruction.points[PointId(99999)] = {};
  Camera unused = reconstruction.cameras.begin()->second;
  unused.id = CameraId(77);
  reconstruction.cameras[unused.id] = unused;
  Write(reconstruction);
  const auto result = RunPlain();
  EXPECT_EQ(result.exit_code, kDone) << result.errors;
  const Reconstruction refined = ReadColmapModel(output());
  EXPECT_FALSE(refined.points.contains(PointId(99999)));
  EXPECT_TRUE(refined.cameras.contains(CameraId(77)));
}

TEST_F(BadRefine, APlaneWithoutANormal) {
  json document = ReadJson(semantics() / "semantics.json");
  for (json& value : document["planes"][0]["normal_in_world"]) value = 0.0;
  WriteJson(semantics() / "semantics.json", document);
  ExpectRefineRefused({"semantics", "normal_in_world"});
}

TEST_F(BadRefine, AnEmptySemanticsFolderMeansPlainAdjustmentAndIsSaid) {
  std::filesystem::remove_all(semantics());
  std::filesystem::create_directory(semantics());
  const auto result = RunPlain({"--semantics", semantics().string()});
  EXPECT_EQ(result.exit_code, kDone);
  EXPECT_THAT(result.errors, HasSubstr("without planes"));
  EXPECT_THAT(Report()["note"].get<std::string>(), HasSubstr("plain bundle adjustment"));
}

TEST_F(BadRefine, DescriptorsAreCutShort) {
  inputs_.Write("model/descriptors.bin", "S3DESC01");
  ExpectPlainRefused(kBadInput, {"descriptors.bin"});
}

/// As COLMAP writes them, from 3.12 on.
constexpr const char* kColmapFrames =
    "# Frame list with one line of data per frame:\n"
    "#   FRAME_ID, RIG_ID, RIG_FROM_WORLD[QW, QX, QY, QZ, TX, TY, TZ], NUM_DATA_IDS, DATA_IDS[] as "
    "(SENSOR_TYPE, SENSOR_ID, DATA_ID)\n"
    "1 1 1 0 0 0 0 0 0 1 CAMERA 1 1\n";

TEST_F(BadRefine, RigsOfAModelAreNotUsedAndThisIsSaid) {
  EXPECT_THAT(RunPlain().errors, ::testing::Not(HasSubstr("rigs")));
  const std::string plain = FileBytes(output() / "images.bin");
  inputs_.Write("model/rigs.txt", "1 1 CAMERA 1\n");
  inputs_.Write("model/frames.txt", kColmapFrames);
  const auto result = RunPlain({"--overwrite"});
  EXPECT_EQ(result.exit_code, kDone) << result.errors;
  EXPECT_THAT(result.errors, HasSubstr("rigs are not used"));
  EXPECT_EQ(FileBytes(output() / "images.bin"), plain);
  EXPECT_FALSE(std::filesystem::exists(output() / "frames.txt"));
}

TEST_F(BadRefine, FramesWithoutTheTimesOfTheImages) {
  inputs_.Write("model/frames.txt", "1.5 0 0 0 0 0 0 1\n");
  ExpectPlainRefused(kBadInput, {"frames.txt but no keyframes.txt"});
}

TEST_F(BadRefine, SigmasOfOtherKeypoints) {
  inputs_.Write("model/keypoint_sigmas.bin", std::string("S3KSIG01") + std::string(8, '\0'));
  ExpectPlainRefused(kBadInput, {"keypoint_sigmas.bin", "of another model"});
}

TEST_F(BadRefine, ConstantPartsThatTheModelDoesNotHave) {
  inputs_.Write("constant.json", R"({"images": ["nowhere.png"]})");
  ExpectPlainRefused(kBadInput, {"constant.json", "nowhere.png"},
                     {"--constant", (inputs_ / "constant.json").string()});
}

TEST_F(BadRefine, PriorsThatLeaveTheWorldOpen) {
  const std::string name = Read().images.begin()->second.name;
  inputs_.Write("priors.txt", name + " 0 0 0 0 0 0 1 0.1 1\n");
  ExpectPlainRefused(kBadInput, {"pose priors"},
                     {"--pose-priors", (inputs_ / "priors.txt").string()});
  inputs_.Write("priors.txt", name + " 0 0 0 0 0 0 1 0.1\n");
  ExpectPlainRefused(kBadInput, {"priors.txt: line 1"},
                     {"--pose-priors", (inputs_ / "priors.txt").string()});
}

TEST_F(BadRefine, CamerasThatTheModelDoesNotHave) {
  ExpectPlainRefused(
      kBadInput, {"camera 1234"},
      {"--set", "intrinsics.focal_length=true", "--set", R"(intrinsics.cameras=["1234"])"});
}

/// An input that a single step only makes worse is no result.
TEST_F(BadRefine, ASolveThatGetsNowhereFails) {
  Reconstruction reconstruction = Read();
  double sign = 1.0;
  for (auto& [id, point] : reconstruction.points) {
    point.xyz += sign * Eigen::Vector3d(1.5, -1.0, 0.8);
    sign = -sign;
  }
  Write(reconstruction);
  ExpectPlainRefused(kFailed, {"no better map than its input"},
                     {"--set", "solver.max_iterations=1"});
}

}  // namespace
}  // namespace s3lam
