#include <fmt/format.h>

#include <filesystem>
#include <string>

#include "common/program.h"
#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/base/output_directory.h"
#include "s3lam/base/timer.h"
#include "s3lam/io/file.h"
#include "s3lam/synthetic/scene.h"
#include "s3lam/synthetic/sequence_writer.h"

namespace s3lam::tools {
namespace {

namespace po = boost::program_options;
using nlohmann::json;

constexpr const char* kDescription =
    "Renders a synthetic sequence with ground truth, the same from the same seed.\n\n"
    "Scenes: desk, floor, posters, room (hand-held camera with lens distortion; written as a TUM\n"
    "RGB-D sequence with COCO panoptic masks), street (a drive; written as a KITTI odometry\n"
    "sequence with KITTI-STEP masks).\n"
    "Reads  nothing.\n"
    "Writes images, camera, times, groundtruth.txt (TUM, world_from_camera), exact and corrupted\n"
    "masks (panoptic_clean or panoptic, panoptic_noisy), the object behind every segment\n"
    "(truth_clean.json, truth_noisy.json), objects.json with the true planes, report.json and\n"
    "config.json.";

struct SynthOptions {
  SceneOptions scene;
  SequenceWriterOptions output;
  void Visit(OptionVisitor& v) {
    v.Group("scene", scene, "what is rendered");
    v.Group("output", output, "what is written");
  }
};

po::options_description Arguments() {
  po::options_description description("s3-synth");
  auto add = description.add_options();
  add("scene", po::value<std::string>()->value_name("NAME"),
      "desk, floor, posters, room or street");
  add("output", po::value<std::string>()->value_name("DIR"), "folder to write");
  add("frames", po::value<int>()->value_name("N"),
      "frames to render (default: the scene's own number); as scene.num_frames");
  add("mask-corruption", po::value<double>()->value_name("X"),
      "0 (exact) to 1, of the noisy masks; as output.masks.level");
  return description;
}

json ReportToJson(const Scene& scene, const SequenceWriterReport& report) {
  return {{"scene", scene.name},
          {"seed", scene.seed},
          {"frames", report.num_frames},
          {"width", scene.camera.width},
          {"height", scene.camera.height},
          {"path_m", report.path_length_m},
          {"objects", report.num_objects},
          {"planar_objects", report.num_planar_objects},
          {"segments_per_frame_clean", report.segments_clean},
          {"segments_per_frame_noisy", report.segments_noisy},
          {"missed_share", report.missed_share},
          {"wrong_class_share", report.wrong_class_share},
          {"seconds", {{"setup", report.setup_seconds}, {"render", report.render_seconds}}},
          {"frames_per_second", report.num_frames / report.render_seconds},
          {"peak_memory_mib", PeakMemoryMiB()}};
}

std::string ReportToTable(const Scene& scene, const SequenceWriterReport& report) {
  return fmt::format(
      "scene             {}, seed {}\n"
      "frames            {} of {} x {}, {:.2f} m of path\n"
      "objects           {}, {} of them planar\n"
      "segments/frame    {:.1f} clean, {:.1f} noisy\n"
      "noisy masks       {:.1f} % of things missed, {:.1f} % of segments with a wrong class\n"
      "seconds           {:.1f} textures, {:.1f} frames ({:.1f} frames/s)\n",
      scene.name, scene.seed, report.num_frames, scene.camera.width, scene.camera.height,
      report.path_length_m, report.num_objects, report.num_planar_objects, report.segments_clean,
      report.segments_noisy, 100.0 * report.missed_share, 100.0 * report.wrong_class_share,
      report.setup_seconds, report.render_seconds, report.num_frames / report.render_seconds);
}

void Run(const po::variables_map& arguments, const CommonArguments& common) {
  SynthOptions options = LoadOptions<SynthOptions>(common);
  if (arguments.count("frames") > 0) {
    options.scene.num_frames = arguments["frames"].as<int>();
    if (options.scene.num_frames <= 0) throw UsageError("--frames must be positive");
  }
  if (arguments.count("mask-corruption") > 0) {
    options.output.masks.level = arguments["mask-corruption"].as<double>();
  }
  CheckOptions(options);
  const Scene scene = MakeScene(Required(arguments, "scene"), common.seed, options.scene);
  OutputDirectory output(Required(arguments, "output"), common.overwrite);
  spdlog::info("{}: {} frames, {} objects, {} surfaces", scene.name, scene.num_frames,
               scene.objects.size(), scene.surfaces.size());

  const SequenceWriterReport report =
      WriteSequence(scene, options.output, output.path(), common.threads);
  const json report_json = ReportToJson(scene, report);
  WriteJson(output.path() / "config.json", OptionsToJson(options));
  WriteJson(output.path() / "report.json", report_json);
  output.Commit();
  PrintReport(common, ReportToTable(scene, report), report_json);
}

}  // namespace
}  // namespace s3lam::tools

int main(int argc, char** argv) {
  s3lam::tools::Program program;
  program.name = "s3-synth";
  program.description = s3lam::tools::kDescription;
  program.arguments.add(s3lam::tools::Arguments());
  s3lam::tools::SetConfiguration(s3lam::tools::SynthOptions{}, program);
  program.run = s3lam::tools::Run;
  return s3lam::tools::RunProgram(argc, argv, program);
}
