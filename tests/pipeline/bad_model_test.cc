// What s3-lift and s3-refine say to models and semantic maps that cannot be used.

#include "pipeline/model_fixture.h"
#include "s3lam/io/frame_observations.h"
#include "s3lam/io/trajectory.h"

namespace s3lam {
namespace {

using testing::FileBytes;
using testing::kDone;
using testing::RunTool;

class BadModel : public testing::ModelTest {
 protected:
  void ExpectBothRefuse(const std::vector<std::string>& parts) {
    ExpectLiftRefused(parts);
    ExpectRefineRefused(parts);
  }
};

TEST_F(BadModel, UnspoiledInputIsAccepted) {
  std::vector<std::string> arguments = LiftArguments();
  arguments.insert(arguments.end(), {"--output", output().string()});
  const auto lifted = RunTool("s3-lift", arguments);
  EXPECT_EQ(lifted.exit_code, kDone) << lifted.errors;
  arguments = RefineArguments();
  arguments.insert(arguments.end(), {"--output", output().string(), "--overwrite"});
  const auto refined = RunTool("s3-refine", arguments);
  EXPECT_EQ(refined.exit_code, kDone) << refined.errors;
}

TEST_F(BadModel, MissingFolder) {
  std::filesystem::remove_all(model());
  ExpectBothRefuse({model().string()});
}

TEST_F(BadModel, EmptyFolder) {
  std::filesystem::remove_all(model());
  std::filesystem::create_directory(model());
  ExpectBothRefuse({model().string()});
}

TEST_F(BadModel, OneFileIsMissing) {
  std::filesystem::remove(model() / "points3D.bin");
  ExpectBothRefuse({model().string()});
}

TEST_F(BadModel, CutShort) {
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const std::string whole = FileBytes(model() / name);
    Truncate(model() / name, 0.6);
    ExpectBothRefuse({(model() / name).string()});
    inputs_.Write(std::filesystem::path("model") / name, whole);
  }
}

TEST_F(BadModel, CountThatTheFileCannotHold) {
  std::string bytes = FileBytes(model() / "points3D.bin");
  for (size_t i = 0; i < 7; ++i) bytes[i] = '\xff';
  inputs_.Write("model/points3D.bin", bytes);
  ExpectBothRefuse({"points3D.bin"});
}

TEST_F(BadModel, ObservationsOfFramesAreCutShortOrOfAnotherModel) {
  const Reconstruction reconstruction = ReadColmapModel(model());
  Trajectory keyframes;
  for (const auto& [id, image] : reconstruction.images) {
    keyframes.push_back({static_cast<double>(id.value()), image.cam_from_world.Inverse()});
  }
  WriteTumTrajectory(keyframes, model() / "keyframes.txt");
  WriteTumTrajectory(keyframes, model() / "frames.txt");
  ObservedFrame frame;
  frame.time_s = keyframes.back().time_s;
  frame.camera_id = reconstruction.cameras.begin()->first;
  frame.observations.push_back({PointId(987654321), {1.0F, 2.0F}, 1.0F});
  WriteFrameObservations({frame}, model() / "observations.bin");
  ExpectRefineRefused({"observations.bin", "987654321"});
  Truncate(model() / "observations.bin", 0.8);
  ExpectRefineRefused({"observations.bin"});
}

TEST_F(BadModel, SemanticsAreMalformed) {
  inputs_.Write("semantics/semantics.json", "{\"format\": ");
  ExpectRefineRefused({"semantics.json"});
}

TEST_F(BadModel, SemanticsOfAnotherModel) {
  SyntheticMapOptions options;
  options.num_images = 8;
  options.num_points = 300;
  WriteColmapModel(MakeSyntheticMap("room", 2, options).estimate, model());
  ExpectRefineRefused({semantics().string(), "model"});
}

TEST_F(BadModel, DistributionsAreCutShort) {
  Truncate(semantics() / "distributions.npy", 0.5);
  ExpectRefineRefused({"distributions.npy"});
}

TEST_F(BadModel, SemanticsFolderIsMissing) {
  std::filesystem::remove_all(semantics());
  ExpectRefineRefused({semantics().string()});
}

}  // namespace
}  // namespace s3lam
