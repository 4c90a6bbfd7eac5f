// All stages, run as a user runs them on a short rendered scene with known truth.

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "chain/chain_support.h"
#include "s3lam/base/sha256.h"
#include "s3lam/base/version.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/ignore_masks.h"
#include "s3lam/io/image_file.h"
#include "s3lam/io/image_sequence.h"
#include "s3lam/io/trajectory.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using nlohmann::json;
using testing::ChainAte;
using testing::ChainFolder;
using testing::ChainReport;
using testing::ExpectSameBytes;
using testing::FileBytes;
using testing::RunProgramApart;
using testing::TempDir;
using testing::Tool;

std::string Sha256Of(const std::filesystem::path& path) {
  Sha256 hash;
  hash.Update(FileBytes(path));
  return hash.Finish();
}

class Masks : public ::testing::TestWithParam<std::string> {
 protected:
  [[nodiscard]] static std::string Lifted() { return "2_lift_" + GetParam(); }
  [[nodiscard]] static std::string Refined() { return "3_refine_" + GetParam(); }
};
INSTANTIATE_TEST_SUITE_P(Chain, Masks, ::testing::Values("clean", "noisy"),
                         [](const auto& test) { return test.param; });

TEST(Chain, EveryFrameIsLocalisedToMillimetres) {
  const json report = ChainReport("1_slam");
  EXPECT_EQ(report["frames_localized"], report["frames"]);
  EXPECT_EQ(ReadTumTrajectory(ChainFolder("1_slam") / "frames.txt").size(), report["frames"]);
  EXPECT_EQ(ReadTumTrajectory(ChainFolder("1_slam") / "keyframes.txt").size(), report["keyframes"]);
  const json error = testing::ChainTrajectoryError("1_slam");
  // 0.1 % of the path is what feature-based SLAM reaches on sharp, well textured images.
  EXPECT_LT(ChainAte("1_slam"), 0.001 * error["path_length"].get<double>());
  EXPECT_EQ(error["num_pairs"], report["frames"]);
}

TEST(Chain, FramesAreAboutAsPreciseAsKeyframes) {
  EXPECT_LT(ChainAte("1_slam"), 1.5 * ChainAte("1_slam", "keyframes.txt"));
  EXPECT_LT(ChainAte("3_refine_plain"), 2.0 * ChainAte("3_refine_plain", "keyframes.txt"));
}

TEST(Chain, PlainAdjustmentDoesNoHarm) {
  EXPECT_LT(ChainAte("3_refine_plain"), 1.2 * ChainAte("1_slam"));
}

TEST_P(Masks, PlanarAdjustmentIsNotWorseThanThePlainOne) {
  EXPECT_LT(ChainAte(Refined()), 1.02 * ChainAte("3_refine_plain"));
}

TEST_P(Masks, PlanarAdjustmentFlattensWhatIsPlanar) {
  const json arms = ChainReport(Refined())["arms"];
  ASSERT_EQ(arms.size(), 3u);
  const double before = arms[0]["plane_rms"];
  const double plain = arms[1]["plane_rms"];
  const double planar = arms[2]["plane_rms"];
  EXPECT_LT(planar, 0.5 * before);
  EXPECT_LT(planar, 0.5 * plain);
}

/// Angle [deg] between a plane's normal and the nearest true normal of its class.
double NormalError(const json& plane, const json& objects,
                   const Eigen::Quaterniond& truth_from_map) {
  const auto& n = plane["normal_in_world"];
  const Eigen::Vector3d normal = truth_from_map * Eigen::Vector3d(n[0], n[1], n[2]);
  double best = 90.0;
  for (const json& object : objects) {
    if (!object["planar"] || object["category_id"] != plane["class_id"]) continue;
    const auto& t = object["plane_gt"]["n"];
    const double cosine = std::abs(normal.dot(Eigen::Vector3d(t[0], t[1], t[2])));
    best = std::min(best, std::acos(std::min(1.0, cosine)) * 180.0 / std::numbers::pi);
  }
  return best;
}

TEST_P(Masks, PlanesLieAsInReality) {
  const json objects = ReadJson(ChainFolder("scene") / "objects.json")["objects"];
  const json planes = ReadJson(ChainFolder(Lifted()) / "semantics.json")["planes"];
  const json error = testing::ChainTrajectoryError("1_slam");
  const auto& q = error["truth_from_estimate"]["rotation_wxyz"];
  const Eigen::Quaterniond truth_from_map(q[0], q[1], q[2], q[3]);
  ASSERT_GE(planes.size(), 8u);
  std::vector<double> errors;
  for (const json& plane : planes) errors.push_back(NormalError(plane, objects, truth_from_map));
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 3.0);
}

TEST_P(Masks, EveryKeyframeHasItsMask) {
  const json report = ChainReport(Lifted());
  EXPECT_EQ(report["images_with_mask"], ChainReport("1_slam")["keyframes"]);
  EXPECT_GT(report["points_labelled"].get<double>(), 0.9 * report["points"].get<double>());
}

TEST_P(Masks, OutputsAreComplete) {
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin", "keyframes.txt",
                           "frames.txt", "descriptors.bin", "observations.bin",
                           "keypoint_sigmas.bin", "project.ini", "report.json", "config.json"}) {
    EXPECT_TRUE(std::filesystem::exists(ChainFolder("1_slam") / name)) << name;
    EXPECT_TRUE(std::filesystem::exists(ChainFolder(Refined()) / name)) << name;
  }
  for (const char* name : {"planes.json", "planes.ply"}) {
    EXPECT_TRUE(std::filesystem::exists(ChainFolder(Refined()) / name)) << name;
  }
  for (const char* name :
       {"semantics.json", "distributions.npy", "planes.ply", "report.json", "config.json"}) {
    EXPECT_TRUE(std::filesystem::exists(ChainFolder(Lifted()) / name)) << name;
  }
  const auto model = ReadColmapModel(ChainFolder("1_slam"));
  for (const char* name : {"model_by_class", "model_by_cluster"}) {
    const auto colored = ReadColmapModel(ChainFolder(Lifted()) / name);
    EXPECT_EQ(colored.points.size(), model.points.size());
    EXPECT_EQ(colored.images.size(), model.images.size());
  }
}

TEST(Chain, ReportsSayWhatTheResultWasMadeOf) {
  for (const std::string stage : {"1_slam", "2_lift_clean", "3_refine_clean"}) {
    const json report = ChainReport(stage);
    EXPECT_EQ(report["version"], Version()) << stage;
    EXPECT_EQ(report["config"], ReadJson(ChainFolder(stage) / "config.json")) << stage;
    EXPECT_EQ(report["seed"], 0) << stage;
  }
  const json images = ChainReport("1_slam")["inputs"]["images"];
  EXPECT_EQ(images["files"], ChainReport("1_slam")["frames"]);
  EXPECT_EQ(images["sha256_of"], "sizes, CRC-32 and names");
  const json lift = ChainReport("2_lift_clean")["inputs"];
  const json refine = ChainReport("3_refine_clean")["inputs"];
  EXPECT_EQ(lift["classes"]["sha256"],
            Sha256Of(std::filesystem::path(S3LAM_TEST_SOURCE_DIR) / "configs/classes/coco.json"));
  EXPECT_EQ(lift["mask_json"]["sha256"], Sha256Of(ChainFolder("scene") / "panoptic_clean.json"));
  EXPECT_EQ(refine["semantics/semantics.json"]["sha256"],
            Sha256Of(ChainFolder("2_lift_clean") / "semantics.json"));
  for (const char* name :
       {"cameras.bin", "images.bin", "points3D.bin", "observations.bin", "keypoint_sigmas.bin"}) {
    const std::string input = std::string("model/") + name;
    EXPECT_EQ(refine[input]["sha256"], Sha256Of(ChainFolder("1_slam") / name)) << name;
    EXPECT_EQ(refine[input]["bytes"], std::filesystem::file_size(ChainFolder("1_slam") / name));
  }
  EXPECT_EQ(lift["model/images.bin"], refine["model/images.bin"]);
}

/// make.sh ran with two threads. A second run has one thread, and one of the linear algebra
/// library, as on a machine with a single core.
void Rerun(const std::string& tool, const std::filesystem::path& output,
           std::vector<std::string> arguments) {
  std::vector<std::string> words = {
      "env",      "OPENBLAS_NUM_THREADS=1", Tool(tool), "--quiet", "--threads", "1",
      "--output", output.string()};
  words.insert(words.end(), arguments.begin(), arguments.end());
  const auto result = RunProgramApart(words);
  ASSERT_EQ(result.exit_code, 0) << result.errors;
}

TEST(SameBytes, SlamWithAnyNumberOfThreads) {
  const TempDir dir;
  Rerun("s3-slam", dir / "again", {"--sequence", ChainFolder("scene").string(), "--database"});
  ExpectSameBytes(ChainFolder("1_slam"), dir / "again");
}

TEST(Chain, DatabaseIsWrittenIfAskedFor) {
  const TempDir dir;
  Rerun(
      "s3-slam", dir / "again",
      {"--sequence", ChainFolder("scene").string(), "--frames", "0:50", "--set", "accuracy=fast"});
  EXPECT_TRUE(std::filesystem::exists(dir / "again" / "cameras.bin"));
  EXPECT_FALSE(std::filesystem::exists(dir / "again" / "database.db"));
  EXPECT_TRUE(std::filesystem::exists(ChainFolder("1_slam") / "database.db"));
}

TEST(Chain, ReportAndConfigurationSayWhatWasLeftOut) {
  const TempDir dir;
  Rerun(
      "s3-slam", dir / "fast",
      {"--sequence", ChainFolder("scene").string(), "--frames", "0:50", "--set", "accuracy=fast"});
  const json report = ReadJson(dir / "fast" / "report.json");
  EXPECT_EQ(report["config"], ReadJson(dir / "fast" / "config.json"));
  EXPECT_EQ(report["config"]["self_calibration"]["enabled"], false);
  const json checked = ChainReport("1_slam");
  for (const char* figure : {"distortion_cost_share", "pinhole_cost_share", "better_pinhole"}) {
    EXPECT_TRUE(report[figure].is_null()) << figure;
    EXPECT_FALSE(checked[figure].is_null()) << figure;
  }
}

TEST(Chain, KeyframesThatSeeTooLittleAreNotInTheModel) {
  const TempDir dir;
  const std::vector<std::string> arguments = {
      "--sequence", ChainFolder("scene").string(), "--frames", "0:90", "--set", "accuracy=fast"};
  Rerun("s3-slam", dir / "all", arguments);
  size_t fewest = std::numeric_limits<size_t>::max();
  const Reconstruction all = ReadColmapModel(dir / "all");
  for (const auto& [id, image] : all.images) {
    size_t count = 0;
    for (const Point2D& keypoint : image.points2D)
      count += keypoint.point_id != kInvalidPointId ? 1 : 0;
    fewest = std::min(fewest, count);
  }
  std::vector<std::string> stricter = arguments;
  stricter.insert(stricter.end(),
                  {"--set", fmt::format("min_localization_inliers={}", fewest + 1)});
  Rerun("s3-slam", dir / "strict", stricter);
  const Reconstruction strict = ReadColmapModel(dir / "strict");
  EXPECT_LT(strict.images.size(), all.images.size());
  EXPECT_EQ(ReadTumTrajectory(dir / "strict" / "keyframes.txt").size(), strict.images.size());
  Rerun("s3-refine", dir / "refined", {"--model", (dir / "strict").string()});
}

TEST(Chain, AnotherSeedGivesAnotherMapAsComplete) {
  const TempDir dir;
  for (const char* seed : {"0", "1"}) {
    Rerun("s3-slam", dir / seed,
          {"--sequence", ChainFolder("scene").string(), "--frames", "0:60", "--set",
           "accuracy=fast", "--seed", seed});
    EXPECT_EQ(ReadTumTrajectory(dir / seed / "frames.txt").size(), 60u) << seed;
  }
  EXPECT_FALSE(FileBytes(dir / "0" / "points3D.bin") == FileBytes(dir / "1" / "points3D.bin"));
}

TEST(SameBytes, LiftWithAnyNumberOfThreads) {
  const TempDir dir;
  Rerun("s3-lift", dir / "again",
        {"--model", ChainFolder("1_slam").string(), "--masks",
         (ChainFolder("scene") / "panoptic_noisy").string(), "--classes",
         std::string(S3LAM_TEST_SOURCE_DIR) + "/configs/classes/coco.json"});
  ExpectSameBytes(ChainFolder("2_lift_noisy"), dir / "again");
}

TEST(SameBytes, RefineWithAnyNumberOfThreads) {
  const TempDir dir;
  Rerun("s3-refine", dir / "again",
        {"--model", ChainFolder("1_slam").string(), "--semantics",
         ChainFolder("2_lift_noisy").string()});
  ExpectSameBytes(ChainFolder("3_refine_noisy"), dir / "again");
}

TEST(SameBytes, SynthWithAnyNumberOfThreads) {
  const TempDir dir;
  for (const char* threads : {"1", "2"}) {
    const auto result = RunProgramApart({Tool("s3-synth"), "--quiet", "--scene", "posters",
                                         "--seed", "3", "--frames", "3", "--threads", threads,
                                         "--output", (dir / threads).string()});
    ASSERT_EQ(result.exit_code, 0) << result.errors;
  }
  ExpectSameBytes(dir / "1", dir / "2");
}

/// Keypoints of all images within a rectangle, and all there are.
std::pair<size_t, size_t> CountWithin(const Reconstruction& model, const cv::Rect2d& rectangle) {
  size_t within = 0;
  size_t all = 0;
  for (const auto& [id, image] : model.images) {
    all += image.points2D.size();
    for (const Point2D& keypoint : image.points2D) {
      within += rectangle.contains({keypoint.xy.x(), keypoint.xy.y()});
    }
  }
  return {within, all};
}

TEST(Chain, ImagesThatCannotBeUsedAreLeftOutOnRequest) {
  const ImageSequence sequence = OpenSequence(ChainFolder("scene"), SequenceFormat::kAuto);
  const TempDir dir;
  WriteCameraJson({*sequence.camera, 30.0}, dir.Write("scene/camera.json", ""));
  for (size_t i = 0; i < 60; ++i) {
    std::string bytes = FileBytes(sequence.frames[i].path);
    if (i == 0 || i == 31) bytes.resize(bytes.size() / 2);
    dir.Write(fmt::format("scene/{:02}.png", i), bytes);
  }
  std::vector<std::string> arguments = {Tool("s3-slam"), "--quiet",
                                        "--set",         "accuracy=fast",
                                        "--sequence",    (dir / "scene").string(),
                                        "--output",      (dir / "map").string()};
  const auto refused = RunProgramApart(arguments);
  EXPECT_EQ(refused.exit_code, 3);
  EXPECT_NE(refused.errors.find("00.png"), std::string::npos) << refused.errors;
  EXPECT_FALSE(std::filesystem::exists(dir / "map"));
  arguments.emplace_back("--lenient");
  const auto result = RunProgramApart(arguments);
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_EQ(ReadTumTrajectory(dir / "map" / "frames.txt").size(), 58u);
  EXPECT_EQ(ReadJson(dir / "map" / "report.json")["images_left_out"].size(), 2u);
}

TEST(Chain, IgnoreMasksKeepFeaturesOffWhatTheyMask) {
  const ImageSequence sequence = OpenSequence(ChainFolder("scene"), SequenceFormat::kAuto);
  const cv::Size size = ReadImageSize(sequence.frames.front().path);
  const cv::Rect middle(size.width / 3, 0, size.width / 3, size.height);
  cv::Mat mask(size, CV_8UC1, cv::Scalar(255));
  mask(middle) = 0;
  const TempDir dir;
  for (const SequenceFrame& frame : sequence.frames) {
    WriteIgnoreMask(mask, dir / "masks", frame.name);
  }
  dir.Write("masks/report.json", "{}");  // No mask.
  std::vector<std::string> arguments = {
      Tool("s3-slam"),         "--quiet",  "--sequence", ChainFolder("scene").string(), "--output",
      (dir / "free").string(), "--frames", "0:60"};
  ASSERT_EQ(RunProgramApart(arguments).exit_code, 0);
  arguments[5] = (dir / "masked").string();
  arguments.insert(arguments.end(), {"--ignore-masks", (dir / "masks").string()});
  const auto result = RunProgramApart(arguments);
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const auto [free_within, free_all] = CountWithin(ReadColmapModel(dir / "free"), middle);
  const auto [masked_within, masked_all] = CountWithin(ReadColmapModel(dir / "masked"), middle);
  EXPECT_GT(free_within, free_all / 5);
  EXPECT_GT(masked_all, free_all / 4);
  EXPECT_EQ(masked_within, 0u);
  EXPECT_EQ(ReadJson(dir / "masked" / "report.json")["inputs"]["ignore_masks"]["files"], 60);
}

}  // namespace
}  // namespace s3lam
