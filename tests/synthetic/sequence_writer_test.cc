#include "s3lam/synthetic/sequence_writer.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <string>

#include "s3lam/base/error.h"
#include "s3lam/base/progress.h"
#include "s3lam/io/file.h"
#include "s3lam/io/image_sequence.h"
#include "s3lam/io/panoptic_masks.h"
#include "s3lam/io/trajectory.h"
#include "s3lam/synthetic/render.h"

namespace s3lam {
namespace {

namespace fs = std::filesystem;

class SequenceWriter : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    SetProgressStyle(ProgressStyle::kNone);
    std::string name = (fs::temp_directory_path() / "s3lam-synthetic-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
  }
  void TearDown() override { fs::remove_all(root_); }

  [[nodiscard]] Scene SmallScene() const {
    SceneOptions options;
    options.num_frames = 3;
    return MakeScene(GetParam(), 11, options);
  }
  fs::path Write(const Scene& scene, const std::string& name, int threads) {
    const fs::path directory = root_ / name;
    fs::create_directory(directory);
    WriteSequence(scene, {}, directory, threads);
    return directory;
  }

  fs::path root_;
};
INSTANTIATE_TEST_SUITE_P(Layouts, SequenceWriter, testing::Values("desk", "street"),
                         [](const auto& scene) { return scene.param; });

std::map<std::string, std::string> AllFiles(const fs::path& directory) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(directory)) {
    if (!entry.is_regular_file()) continue;
    files[fs::relative(entry.path(), directory).string()] = ReadFile(entry.path());
  }
  return files;
}

TEST_P(SequenceWriter, WritesTheSameBytesForAnyNumberOfThreads) {
  const Scene scene = SmallScene();
  EXPECT_TRUE(AllFiles(Write(scene, "one", 1)) == AllFiles(Write(scene, "two", 2)));
}

TEST_P(SequenceWriter, ReadsBackAsARealSequence) {
  const Scene scene = SmallScene();
  const fs::path directory = Write(scene, "sequence", 2);
  const ImageSequence sequence = OpenSequence(directory, SequenceFormat::kAuto);
  ASSERT_EQ(sequence.frames.size(), 3u);
  ASSERT_TRUE(sequence.camera.has_value());
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(30.0, 40.0), Eigen::Vector2d(500.0, 300.0)}) {
    EXPECT_LT(
        (*sequence.camera->CameraFromImage(pixel) - *scene.camera.CameraFromImage(pixel)).norm(),
        1e-9);
  }
  const FrameReader reader(sequence);
  const Renderer renderer(scene, 2);
  const cv::Mat image = reader.Read(2);
  const cv::Mat rendered = renderer.Render(2).image;
  ASSERT_EQ(image.size(), rendered.size());
  ASSERT_EQ(image.type(), rendered.type());
  EXPECT_LT(cv::norm(image, rendered, cv::NORM_L1) /
                static_cast<double>(image.total() * image.elemSize()),
            4.0);  // JPEG.
  const Trajectory truth = ReadTumTrajectory(directory / "groundtruth.txt");
  ASSERT_EQ(truth.size(), 3u);
  EXPECT_NEAR(truth[2].time_s, sequence.frames[2].time_s, 1e-6);
  EXPECT_LT((truth[2].world_from_camera.translation - scene.WorldFromCamera(2).translation).norm(),
            1e-9);
}

TEST_P(SequenceWriter, MasksReadBackAsTheyWereMade) {
  const Scene scene = SmallScene();
  const fs::path directory = Write(scene, "sequence", 2);
  const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
  const cv::Mat labels = renderer.RenderLabels(1).labels;
  const bool is_coco = scene.layout == SequenceLayout::kTumCoco;
  const std::string clean_name = is_coco ? "panoptic_clean" : "panoptic";
  for (const std::string& name : {clean_name, std::string("panoptic_noisy")}) {
    const PanopticMasks masks(directory / name, MaskFormat::kAuto, {}, scene.class_table);
    ASSERT_EQ(masks.names().size(), 3u);
    EXPECT_EQ(masks.format(), is_coco ? MaskFormat::kCoco : MaskFormat::kKittiStep);
    const PanopticFrame read = masks.Read(1);
    const SyntheticPanoptic made = name == clean_name ? MakePanoptic(scene, 1, labels)
                                                      : MakeCorruptedPanoptic(scene, 1, labels, {});
    EXPECT_TRUE(read.segment_ids == made.frame.segment_ids);
    ASSERT_EQ(read.segments.size(), made.frame.segments.size());
    for (const auto& [id, segment] : made.frame.segments) {
      EXPECT_EQ(read.segments.at(id).class_index, segment.class_index);
      if (is_coco) {
        EXPECT_EQ(read.segments.at(id).score, segment.score);
      }
    }
  }
}

TEST_P(SequenceWriter, TruthFilesNameObjectsAndPlanes) {
  const Scene scene = SmallScene();
  const fs::path directory = Write(scene, "sequence", 2);
  const auto objects = ReadJson(directory / "objects.json")["objects"];
  ASSERT_EQ(objects.size(), scene.objects.size());
  for (size_t i = 0; i < objects.size(); ++i) {
    EXPECT_EQ(objects[i]["id"], scene.objects[i].id);
    ASSERT_EQ(objects[i]["planar"], scene.objects[i].plane_in_world.has_value());
    if (!scene.objects[i].plane_in_world) continue;
    const auto& plane = objects[i]["plane_gt"];
    const Eigen::Vector3d normal(plane["n"][0], plane["n"][1], plane["n"][2]);
    EXPECT_NEAR(normal.norm(), 1.0, 1e-8);
    const double tolerance = scene.objects[i].flatness_m + 1e-4;
    for (const auto& corner : objects[i]["polygon_gt"]) {
      const Eigen::Vector3d point(corner[0], corner[1], corner[2]);
      EXPECT_LT(std::abs(normal.dot(point) + plane["d"].get<double>()), tolerance);
    }
  }
  const auto truth = ReadJson(directory / "truth_noisy.json");
  EXPECT_EQ(truth["frames"].size(), 3u);
  EXPECT_EQ(truth["missed"].size(), 3u);
}

TEST(SequenceWriterOptions, RejectsAnUnknownImageFormat) {
  SequenceWriterOptions options;
  options.image_format = "bmp";
  SceneOptions small;
  small.num_frames = 1;
  EXPECT_THROW(WriteSequence(MakeScene("desk", 1, small), options, fs::temp_directory_path(), 1),
               UsageError);
}

}  // namespace
}  // namespace s3lam
