#include <filesystem>
#include <optional>

#include "common/checkpoint.h"
#include "common/program.h"
#include "common/provenance.h"
#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/base/output_directory.h"
#include "s3lam/base/timer.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/constraints.h"
#include "s3lam/io/descriptors.h"
#include "s3lam/io/file.h"
#include "s3lam/io/frame_observations.h"
#include "s3lam/io/keypoint_sigmas.h"
#include "s3lam/io/semantic_map_io.h"
#include "s3lam/io/trajectory.h"
#include "s3lam/refine/pipeline.h"
#include "s3lam/refine/plane_output.h"

namespace s3lam::tools {
namespace {

namespace fs = std::filesystem;
namespace po = boost::program_options;

constexpr const char* kDescription =
    "Refines a COLMAP model by bundle adjustment with the planes of its semantic map.\n\n"
    "Reads  --model      cameras, images, points3D (.bin or .txt); keyframes.txt (TUM, one line "
    "per\n"
    "                    image in ascending image id), frames.txt (poses of all frames) and\n"
    "                    observations.bin (what those see), keypoint_sigmas.bin (else those\n"
    "                    of a camera are alike), where they are there; the latter,\n"
    "                    descriptors.bin and project.ini are handed on\n"
    "       --semantics  semantics.json, distributions.npy of that model; an empty folder or none "
    "at\n"
    "                    all means bundle adjustment without planes\n"
    "       --constant   {\"images\": [\"name\", ...], \"points\": [id, ...]}, \"all\" for a list: "
    "what\n"
    "                    stays as it is; \"plane_distances\": [{\"planes\": [id, id],\n"
    "                    \"distance\": d, \"sigma\": s}, ...]: parallel planes so far apart [map "
    "units]\n"
    "       --pose-priors  lines 't tx ty tz qx qy qz qw sigma_position sigma_rotation' in the\n"
    "                    model's world or in another, into which the map is brought\n"
    "                    (world_from_camera; units of that world, degrees; 0: not known), an\n"
    "                    image's name in the place of the time t if there is no keyframes.txt\n"
    "Writes --output     the refined COLMAP model, keyframes.txt, frames.txt, planes.json,\n"
    "                    planes.ply, report.json and report.txt (before and after), config.json; "
    "on request\n"
    "                    covariance.json";

/// COLMAP's frames.txt, of rigs of cameras, is no trajectory.
bool HasTrajectoryOfFrames(const fs::path& model) {
  return fs::exists(model / "frames.txt") && !fs::exists(model / "rigs.txt");
}

void WarnOfRigs(const fs::path& model) {
  if (!fs::exists(model / "rigs.txt") && !fs::exists(model / "rigs.bin")) return;
  spdlog::warn(
      "{}: rigs are not used: cameras are taken as independent, and rigs and frames are not "
      "written",
      model.string());
}

void ReadTrajectories(const fs::path& model, refine::Input& input) {
  if (fs::exists(model / "keyframes.txt")) {
    const Trajectory keyframes = ReadTumTrajectory(model / "keyframes.txt");
    if (keyframes.size() != input.model.images.size()) {
      ThrowInputError("{}: {} poses, but the model has {} images",
                      (model / "keyframes.txt").string(), keyframes.size(),
                      input.model.images.size());
    }
    for (const TimedPose& pose : keyframes) input.image_times_s.push_back(pose.time_s);
  }
  if (!HasTrajectoryOfFrames(model)) return;
  if (input.image_times_s.empty()) {
    ThrowInputError(
        "{}: has frames.txt but no keyframes.txt to tell the images' times: bring both or neither",
        model.string());
  }
  input.frames = ReadTumTrajectory(model / "frames.txt");
  const fs::path observations = model / "observations.bin";
  if (!fs::exists(observations)) return;
  input.observations = ReadFrameObservations(observations);
  CheckFrameObservations(input.observations, input.model, input.frames, observations.string());
}

SemanticMap ReadSemantics(const fs::path& directory, const Reconstruction& model) {
  if (directory.empty() || (fs::is_directory(directory) && fs::is_empty(directory))) {
    spdlog::warn("no semantic map given: bundle adjustment without planes");
    return {};
  }
  SemanticMap semantics = ReadSemanticMap(directory);
  CheckSemanticMap(semantics, model, directory.string());
  CheckMadeFromModel(semantics, FingerprintOfModel(model), directory.string());
  return semantics;
}

std::string Given(const po::variables_map& arguments, const std::string& name) {
  return arguments.count(name) > 0 ? arguments[name].as<std::string>() : "";
}

void ReadConstraints(const po::variables_map& arguments, refine::Input& input) {
  const std::string constant = Given(arguments, "constant");
  if (!constant.empty()) ReadConstantParts(constant, input.model, input.constraints);
  const std::string priors = Given(arguments, "pose-priors");
  if (priors.empty()) return;
  ReadPosePriors(priors, input.model, input.image_times_s, input.constraints);
}

refine::Input ReadInput(const po::variables_map& arguments) {
  const fs::path model = Required(arguments, "model");
  if (!fs::is_directory(model)) ThrowInputError("{}: no such folder", model.string());
  refine::Input input;
  input.model = ReadColmapModel(model);
  WarnOfRigs(model);
  ReadTrajectories(model, input);
  input.semantics = ReadSemantics(Given(arguments, "semantics"), input.model);
  ReadConstraints(arguments, input);
  if (fs::exists(model / "keypoint_sigmas.bin")) {
    input.keypoint_sigmas = ReadKeypointSigmas(model / "keypoint_sigmas.bin");
    CheckKeypointSigmas(input.keypoint_sigmas, input.model,
                        (model / "keypoint_sigmas.bin").string());
  }
  if (fs::exists(model / "descriptors.bin")) {
    input.descriptors = ReadDescriptors(model / "descriptors.bin");
  }
  return input;
}

void CopyIfPresent(const fs::path& from, const fs::path& to) {
  if (fs::exists(from)) fs::copy_file(from, to, fs::copy_options::overwrite_existing);
}

void WriteOutput(const fs::path& model, const refine::Options& options,
                 const refine::Output& output, const refine::Report& report,
                 const nlohmann::json& figures, const fs::path& directory) {
  WriteColmapModel(output.model, directory);
  if (!output.keyframes.empty()) WriteTumTrajectory(output.keyframes, directory / "keyframes.txt");
  if (!output.frames.empty()) WriteTumTrajectory(output.frames, directory / "frames.txt");
  if (!output.observations.empty()) {
    WriteFrameObservations(output.observations, directory / "observations.bin");
  }
  WriteJson(directory / "planes.json", PlanesToJson(output.semantics));
  WritePlanesPly(output.semantics, directory / "planes.ply");
  if (output.covariance.computed) {
    WriteJson(directory / "covariance.json", ToJson(output.covariance, output.model));
  }
  CopyIfPresent(model / "descriptors.bin", directory / "descriptors.bin");
  CopyIfPresent(model / "keypoint_sigmas.bin", directory / "keypoint_sigmas.bin");
  CopyIfPresent(model / "project.ini", directory / "project.ini");
  WriteJson(directory / "report.json", figures);
  WriteFile(directory / "report.txt", [&](std::ostream& stream) { stream << ToTable(report); });
  WriteJson(directory / "config.json", OptionsToJson(options));
}

Provenance DescribeInputs(const po::variables_map& arguments, const CommonArguments& common,
                          const refine::Options& options) {
  Provenance provenance("s3-refine", common, OptionsToJson(options));
  provenance.AddFiles("model", Required(arguments, "model"), ModelFiles());
  const std::string semantics = Given(arguments, "semantics");
  if (!semantics.empty()) {
    provenance.AddFiles("semantics", semantics, {"semantics.json", "distributions.npy"});
  }
  for (const char* file : {"constant", "pose-priors"}) {
    provenance.AddFile(file, Given(arguments, file));
  }
  return provenance;
}

void Refine(const po::variables_map& arguments, const CommonArguments& common) {
  const fs::path model = Required(arguments, "model");
  OutputDirectory directory(Required(arguments, "output"), common.overwrite);
  auto options = LoadOptions<refine::Options>(common);
  options.num_threads = common.threads;
  options.solver.num_threads = common.threads;
  options.camera_height.seed = common.seed;
  options.covariance.enabled |= arguments.count("covariance") > 0;
  if (arguments.count("gravity") > 0) options.gravity.mode = GravityMode::kFloor;

  const Timer timer;
  refine::Input input = ReadInput(arguments);
  const Provenance provenance = DescribeInputs(arguments, common, options);
  const auto checkpoint = OpenCheckpoint(arguments, common, provenance);
  input.steps = checkpoint.get();
  const double read_s = timer.Seconds();
  refine::Output output;
  refine::Report report = refine::Run(options, input, output);
  report.seconds["read"] = read_s;
  nlohmann::json figures = ToJson(report);
  provenance.AddTo(figures);
  // Which model's semantic map has the ids of this one's points.
  figures["input_model_fingerprint"] = FingerprintOfModel(input.model);
  WriteOutput(model, options, output, report, figures, directory.path());
  directory.Commit();
  if (checkpoint) checkpoint->Remove();
  figures.erase("config");
  PrintReport(common, ToTable(report), figures);
}

}  // namespace
}  // namespace s3lam::tools

int main(int argc, char** argv) {
  using namespace s3lam;
  namespace po = boost::program_options;
  tools::Program program{"s3-refine", tools::kDescription, po::options_description("Arguments"), {},
                         {},          tools::Refine};
  auto add = program.arguments.add_options();
  add("model", po::value<std::string>()->value_name("DIR"), "COLMAP model to refine");
  add("semantics", po::value<std::string>()->value_name("DIR"), "what s3-lift wrote for it");
  add("constant", po::value<std::string>()->value_name("FILE"),
      "JSON: images and points that stay as they are, known distances of planes");
  add("pose-priors", po::value<std::string>()->value_name("FILE"),
      "poses known beforehand (TUM with two sigmas)");
  add("covariance", "write covariance.json: short for --set covariance.enabled=true");
  add("gravity", "z up and the floor at z = 0: short for --set gravity.mode=floor");
  add("output", po::value<std::string>()->value_name("DIR"), "folder to write");
  tools::AddCheckpointArguments(program.arguments);
  tools::SetConfiguration(refine::Options(), program);
  return tools::RunProgram(argc, argv, program);
}
