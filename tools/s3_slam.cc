#include <fmt/format.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>

#include "common/checkpoint.h"
#include "common/config_files.h"
#include "common/program.h"
#include "common/provenance.h"
#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/base/output_directory.h"
#include "s3lam/io/camera_guess.h"
#include "s3lam/io/colmap_database.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/descriptors.h"
#include "s3lam/io/file.h"
#include "s3lam/io/frame_observations.h"
#include "s3lam/io/ignore_masks.h"
#include "s3lam/io/image_sequence.h"
#include "s3lam/io/keypoint_sigmas.h"
#include "s3lam/io/trajectory.h"
#include "s3lam/slam/pipeline.h"

namespace s3lam::tools {
namespace {

namespace po = boost::program_options;

constexpr const char* kDescription =
    "Monocular keyframe SLAM over an image sequence, offline: every frame is localised.\n\n"
    "Reads   --sequence: a folder (TUM RGB-D, KITTI odometry or raw, EuRoC, plain images) or a\n"
    "        video; the camera from --camera, else from what the sequence brings. With --camera\n"
    "        auto it is guessed from EXIF data, else as a common lens, and refined with the map\n"
    "        (RADIAL); the report says by how much and how surely.\n"
    "Writes  --output: cameras.bin, images.bin, points3D.bin (COLMAP), keyframes.txt and\n"
    "        frames.txt (TUM, world_from_camera), descriptors.bin, observations.bin (what frames\n"
    "        that are no keyframes see), keypoint_sigmas.bin, project.ini, report.json,\n"
    "        config.json; database.db if asked for. Where the sequence falls apart, this is the\n"
    "        largest map; others that do not meet it go to the folders 1, 2, ... of it. The\n"
    "        report says which frames are to be trusted.";

SequenceFormat ParseFormat(const std::string& name) {
  const auto format = SequenceFormatFromName(name);
  if (!format) {
    throw UsageError(fmt::format(
        "--format {}: expected auto, tum, kitti, kitti-raw, euroc, folder or video", name));
  }
  return *format;
}

constexpr const char* kCameraAuto = "auto";

/// What --camera says; empty without it.
std::string CameraArgument(const po::variables_map& arguments) {
  return arguments.count("camera") > 0 ? arguments["camera"].as<std::string>() : "";
}

/// A sequence with a camera, which may be a guess.
struct Opened {
  ImageSequence sequence;
  std::optional<CameraGuess> guess;
  std::vector<std::string> left_out;  // Images, and why.
};

/// Of --lenient.
std::vector<std::string> LeaveOutAndWarn(int num_threads, ImageSequence& sequence) {
  const size_t num_frames = sequence.frames.size();
  std::vector<std::string> left_out = LeaveOutUnusable(num_threads, sequence);
  if (!left_out.empty()) {
    spdlog::warn("{} of {} images cannot be used and are left out; the first is {}",
                 left_out.size(), num_frames, left_out.front());
  }
  return left_out;
}

Opened Open(const po::variables_map& arguments, int num_threads) {
  const std::string path = Required(arguments, "sequence");
  const FrameRange range = arguments.count("frames") > 0
                               ? ParseFrameRange(arguments["frames"].as<std::string>())
                               : FrameRange{};
  const bool is_lenient = arguments["lenient"].as<bool>();
  Opened opened;
  ImageSequence& sequence = opened.sequence;
  const std::string camera = CameraArgument(arguments);
  sequence = OpenSequence(path, ParseFormat(arguments["format"].as<std::string>()), range,
                          camera.empty() ? OwnCamera::kRead : OwnCamera::kIgnored,
                          is_lenient ? MissingImages::kKept : MissingImages::kRefused);
  if (!camera.empty() && camera != kCameraAuto) {
    sequence.camera = ReadCameraJson(FindConfigFile(camera, "cameras")).camera;
  }
  if (is_lenient) opened.left_out = LeaveOutAndWarn(num_threads, sequence);
  if (camera == kCameraAuto) {
    opened.guess = GuessCamera(sequence);
    sequence.camera = opened.guess->camera;
    spdlog::info("focal length guessed by {}: {:.0f} px, to within {:.0f} %", opened.guess->source,
                 opened.guess->camera.FocalX(), 100.0 * opened.guess->relative_sigma);
  }
  if (!sequence.camera) {
    ThrowInputError(
        "{}: no camera: give --camera FILE, put a camera.json into the folder, or let --camera "
        "auto "
        "find out",
        path);
  }
  return opened;
}

slam::Input MakeInput(const Opened& opened, const FrameReader& reader,
                      const std::filesystem::path& ignore_masks) {
  const ImageSequence& sequence = opened.sequence;
  slam::Input input;
  input.camera = *sequence.camera;
  if (opened.guess) {
    input.focal_prior = FocalPrior{input.camera.FocalX(), opened.guess->relative_sigma};
  }
  for (const SequenceFrame& frame : sequence.frames) {
    input.times_s.push_back(frame.time_s);
    input.names.push_back(frame.name);
  }
  input.read_gray = [&reader](size_t i) { return reader.ReadGray(i); };
  input.read_color = [&reader](size_t i) { return reader.Read(i); };
  if (!ignore_masks.empty()) {
    const cv::Size size(input.camera.width, input.camera.height);
    input.read_mask = [&sequence, ignore_masks, size](size_t i) {
      return ReadIgnoreMask(ignore_masks, sequence.frames[i].name, size);
    };
  }
  input.concurrent_reads = reader.IsThreadSafe();
  return input;
}

void WriteModel(const slam::Model& model, const ImageSequence& sequence, bool with_database,
                const std::filesystem::path& directory) {
  WriteColmapModel(model.reconstruction, directory);
  if (with_database) WriteColmapDatabase(model.reconstruction, directory / "database.db");
  WriteColmapProject(std::filesystem::absolute(sequence.image_root), directory / "project.ini");
  WriteTumTrajectory(model.keyframes, directory / "keyframes.txt");
  WriteTumTrajectory(model.frames, directory / "frames.txt");
  WriteDescriptors(model.descriptors, directory / "descriptors.bin");
  WriteFrameObservations(model.observations, directory / "observations.bin");
  WriteKeypointSigmas(model.keypoint_sigmas, directory / "keypoint_sigmas.bin");
}

/// The folder or file given; throws unless some frame has a mask there.
std::filesystem::path CheckIgnoreMasks(const po::variables_map& arguments,
                                       const ImageSequence& sequence) {
  if (arguments.count("ignore-masks") == 0) return {};
  std::filesystem::path masks = arguments["ignore-masks"].as<std::string>();
  const auto count =
      std::count_if(sequence.frames.begin(), sequence.frames.end(),
                    [&](const SequenceFrame& frame) { return HasIgnoreMask(masks, frame.name); });
  if (count == 0) {
    ThrowInputError("{}: no mask of any frame in it, such as {}.png", masks.string(),
                    sequence.frames.front().name);
  }
  spdlog::info("{} of {} frames have a mask of what to ignore", count, sequence.frames.size());
  return masks;
}

/// The largest map lies in the folder itself, others in folders 1, 2, ... of it.
void Write(const slam::Result& result, const nlohmann::json& config, const nlohmann::json& report,
           const ImageSequence& sequence, bool with_databases,
           const std::filesystem::path& directory) {
  for (size_t m = 0; m < result.models.size(); ++m) {
    const auto folder = m == 0 ? directory : directory / std::to_string(m);
    std::filesystem::create_directories(folder);
    WriteModel(result.models[m], sequence, with_databases, folder);
  }
  WriteJson(directory / "report.json", report);
  WriteJson(directory / "config.json", config);
}

std::string Table(const slam::Report& report, size_t num_left_out, const std::string& output) {
  const slam::MapReport& main = report.maps.front();
  std::string table;
  table += fmt::format("frames localised    {} of {}\n", main.num_frames, report.num_frames);
  if (num_left_out > 0) table += fmt::format("images left out     {}\n", num_left_out);
  table += fmt::format("keyframes           {}\n", main.num_keyframes);
  table += fmt::format("points              {}\n", main.num_points);
  table += fmt::format("mean track length   {:.2f}\n", main.mean_track_length);
  table += fmt::format("reprojection RMS    {:.3f} px\n", main.rms_px);
  table += fmt::format("loops closed        {}\n", main.loops.closed.size());
  if (report.focal) {
    table +=
        fmt::format("focal length        {:.1f} px refined from a guess of {:.0f}, sigma {:.2f}\n",
                    report.focal->refined, report.focal->guess, report.focal->Sigma());
  }
  if (!report.better_pinhole.empty()) {
    table += fmt::format("calibration         in doubt: {}\n",
                         DescribeBetterPinhole(report.better_pinhole, report.pinhole_cost_share));
  }
  if (report.rolling_shutter && report.rolling_shutter->is_compensated) {
    table += fmt::format("rolling shutter     corrected: {:.1f} ms, {}\n",
                         1e3 * report.rolling_shutter->readout_s,
                         ShutterDirectionName(report.rolling_shutter->direction));
  } else if (report.rolling_shutter && report.rolling_shutter->is_seen) {
    table += fmt::format("rolling shutter     seen: about {:.1f} ms, not corrected\n",
                         1e3 * report.rolling_shutter->readout_s);
  }
  for (size_t m = 1; m < report.maps.size(); ++m) {
    const slam::MapReport& map = report.maps[m];
    table += fmt::format("map apart           {}/{}: {} frames of {} to {}, {} keyframes\n", output,
                         m, map.num_frames, map.first_frame, map.last_frame, map.num_keyframes);
  }
  for (const slam::StretchReport& stretch : report.stretches) {
    if (stretch.state == slam::StretchReport::State::kGood) continue;
    const bool lost = stretch.state == slam::StretchReport::State::kLost;
    table += fmt::format("{}     frames {} to {}{}\n", lost ? "not localised  " : "little trusted ",
                         stretch.first_frame, stretch.last_frame,
                         stretch.doubt ? fmt::format(": {}", Describe(*stretch.doubt)) : "");
  }
  if (main.initial_other_motions > 0) {
    table += fmt::format("planar start        {} other motions, error {:.2f} for {:.2f} sigma^2\n",
                         main.initial_other_motions, main.initial_other_error, main.initial_error);
  }
  for (const slam::StopReport& stop : report.stops) {
    const bool turns = stop.kind == slam::StopReport::Kind::kRotation;
    table +=
        fmt::format("{}frames {} to {}{}\n",
                    turns ? "turns on the spot   " : "stands still        ", stop.first_frame,
                    stop.last_frame, turns ? fmt::format(", by {:.1f} deg", stop.turn_deg) : "");
  }
  for (const auto& [step, seconds] : report.seconds) {
    table += fmt::format("{:<26}{:8.2f} s\n", step, seconds);
  }
  table += fmt::format("peak memory         {:.0f} MiB\n", PeakMemoryMiB());
  table += fmt::format("written to          {}\n", output);
  return table;
}

/// The masks alone: s3-lift's report beside them says what they were made of.
void AddIgnoreMasks(const std::filesystem::path& given, const ImageSequence& sequence,
                    Provenance& provenance) {
  if (std::filesystem::is_regular_file(given)) return provenance.AddFile("ignore_masks", given);
  std::vector<std::filesystem::path> masks;
  for (const SequenceFrame& frame : sequence.frames) {
    if (HasIgnoreMask(given, frame.name)) masks.push_back(IgnoreMaskPath(given, frame.name));
  }
  provenance.AddListing("ignore_masks", given, masks);
}

Provenance DescribeInputs(const po::variables_map& arguments, const CommonArguments& common,
                          const slam::Options& options, const ImageSequence& sequence) {
  Provenance provenance("s3-slam", common, OptionsToJson(slam::Effective(options)));
  const std::string camera = CameraArgument(arguments);
  if (camera != kCameraAuto) provenance.AddFile("camera", FindConfigFile(camera, "cameras"));
  // What the formats bring beside the images: times, calibration.
  provenance.AddFiles("sequence", Required(arguments, "sequence"),
                      {"camera.json", "rgb.txt", "times.txt", "calib.txt",
                       "image_00/timestamps.txt", "calib_cam_to_cam.txt", "../calib_cam_to_cam.txt",
                       "mav0/cam0/data.csv", "mav0/cam0/sensor.yaml"});
  std::vector<std::filesystem::path> images;
  for (const SequenceFrame& frame : sequence.frames) {
    images.push_back(frame.path.empty() ? sequence.image_root : frame.path);
    if (frame.path.empty()) break;  // A video is one file.
  }
  provenance.AddListing("images", sequence.image_root, images);
  std::string frames;
  for (const SequenceFrame& frame : sequence.frames) {
    frames += fmt::format("{} {} {}\n", frame.index, frame.time_s, frame.name);
  }
  provenance.AddText("frames", frames);
  const Camera& used = *sequence.camera;
  provenance.AddText("used_camera", fmt::format("{} {} {} {} {}\n", camera == kCameraAuto,
                                                CameraModelName(used.model), used.width,
                                                used.height, fmt::join(used.params, " ")));
  if (arguments.count("ignore-masks") > 0) {
    AddIgnoreMasks(arguments["ignore-masks"].as<std::string>(), sequence, provenance);
  }
  return provenance;
}

void RunSlam(const po::variables_map& arguments, const CommonArguments& common) {
  const std::string output = Required(arguments, "output");
  auto options = LoadOptions<slam::Options>(common);
  options.num_threads = common.threads;
  options.seed = common.seed;
  const double save_every_s = arguments["checkpoint-every"].as<double>();
  if (!(save_every_s >= 0.0)) throw UsageError("--checkpoint-every must not be negative");
  const Opened opened = Open(arguments, common.threads);
  const ImageSequence& sequence = opened.sequence;
  const std::filesystem::path ignore_masks = CheckIgnoreMasks(arguments, sequence);
  OutputDirectory directory(output, common.overwrite);
  spdlog::info("{} frames, camera {} {} x {}", sequence.frames.size(),
               CameraModelName(sequence.camera->model), sequence.camera->width,
               sequence.camera->height);
  const Provenance provenance = DescribeInputs(arguments, common, options, sequence);
  const FrameReader reader(sequence);
  const auto checkpoint = OpenCheckpoint(arguments, common, provenance);
  slam::Input input = MakeInput(opened, reader, ignore_masks);
  input.steps = checkpoint.get();
  input.save_every_s = save_every_s;
  const slam::Result result = slam::Run(options, input);
  nlohmann::json report = ToJson(result.report);
  provenance.AddTo(report);
  if (opened.guess) report["focal_length"]["source"] = opened.guess->source;
  report["images_left_out"] = opened.left_out;
  report["peak_memory_mib"] = PeakMemoryMiB();
  Write(result, provenance.config(), report, sequence, arguments["database"].as<bool>(),
        directory.path());
  directory.Commit();
  if (checkpoint) checkpoint->Remove();
  for (const char* long_one : {"per_frame", "config"}) report.erase(long_one);
  PrintReport(common, Table(result.report, opened.left_out.size(), output), report);
}

}  // namespace
}  // namespace s3lam::tools

int main(int argc, char** argv) {
  using namespace s3lam::tools;
  namespace po = boost::program_options;
  Program program;
  program.name = "s3-slam";
  program.description = kDescription;
  auto add = program.arguments.add_options();
  add("sequence", po::value<std::string>()->value_name("DIR|VIDEO"), "the images");
  add("format", po::value<std::string>()->default_value("auto"),
      "auto, tum, kitti, kitti-raw, euroc, folder or video");
  add("camera", po::value<std::string>()->value_name("FILE"),
      "camera.json, a name such as tum_fr1, or auto: not known");
  add("frames", po::value<std::string>()->value_name("A:B:STEP"), "use only these frames");
  add("lenient", po::bool_switch(),
      "leave out and count images that cannot be read or are of another size than the camera's; "
      "decodes all of them once more");
  add("ignore-masks", po::value<std::string>()->value_name("DIR|FILE"),
      "gray PNGs <image name>.png, no features where they are 0; of things that move, by s3-lift; "
      "or one PNG for all images, of what is burnt into them or hangs before the lens");
  add("database", po::bool_switch(),
      "also write database.db: keypoints and matches of the keyframes, for colmap mapper; without "
      "descriptors, so COLMAP's matchers can add none");
  add("output", po::value<std::string>()->value_name("DIR"), "where the result goes");
  AddCheckpointArguments(program.arguments);
  add("checkpoint-every", po::value<double>()->default_value(30.0)->value_name("S"),
      "seconds of tracking after which the state is kept again");
  SetConfiguration(s3lam::slam::Options{}, program);
  program.run = RunSlam;
  return RunProgram(argc, argv, program);
}
