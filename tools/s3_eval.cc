#include <fmt/format.h>

#include <boost/program_options.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/config_files.h"
#include "common/program.h"
#include "s3lam/base/error.h"
#include "s3lam/base/output_file.h"
#include "s3lam/eval/cloud_metrics.h"
#include "s3lam/eval/model_difference.h"
#include "s3lam/eval/plane_angles.h"
#include "s3lam/eval/plane_errors.h"
#include "s3lam/eval/trajectory_error.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/file.h"
#include "s3lam/io/semantic_map_io.h"
#include "s3lam/io/trajectory.h"

namespace s3lam::tools {
namespace {

namespace po = boost::program_options;

constexpr const char* kDescription =
    "Measures trajectories, planes and maps.\n\n"
    "--estimate, --ground-truth   absolute trajectory error (ATE) after alignment, in the axes of\n"
    "        the world and of the camera, along and across the way; relative pose error (RPE) of\n"
    "        consecutive poses, per length, and over KITTI's segments. --time-offset allows for\n"
    "        clocks that differ, and tells the ATE without and with it.\n"
    "--planes                     angles between the planes of semantics.json or planes.json.\n"
    "--model, --semantics         how flat the points of each labelled plane lie; with the\n"
    "        semantics of this model, or of the one that s3-refine made it of.\n"
    "--known-planes               planes (of --planes, or else those that fit the points of\n"
    "        --model and --semantics best) against known ones, in the alignment of the "
    "trajectory.\n"
    "--model, --other-model       camera poses of two COLMAP models of the same images.\n\n"
    "Reads trajectories as TUM (time tx ty tz qx qy qz qw) or KITTI (3x4 matrices) files,\n"
    "world_from_camera. Writes a table, or JSON, to standard output; lengths are in the ground\n"
    "truth's unit.";

struct EvalOptions {
  TrajectoryErrorOptions trajectory;
  PlaneErrorOptions planes;

  void Visit(OptionVisitor& v) {
    trajectory.Visit(v);
    v.Group("planes", planes, "Fitted against known planes");
  }
};

struct Result {
  std::string table;
  nlohmann::json json = nlohmann::json::object();
  /// Of --per-pose; with the names of their images, or none.
  std::vector<PoseError> poses;
  std::vector<std::string> pose_names;

  void Add(const char* name, const std::string& text, nlohmann::json value) {
    if (!table.empty()) table += "\n";
    table += text;
    json[name] = std::move(value);
  }
};

/// The file of --per-pose, empty without it. Throws InputError if it must not be written.
std::optional<OutputFile> OpenPerPose(const po::variables_map& arguments, bool overwrite) {
  if (arguments.count("per-pose") == 0) return std::nullopt;
  return std::optional<OutputFile>(std::in_place, Required(arguments, "per-pose"), overwrite);
}

/// One line per pose, for plots.
std::string PosesText(const std::filesystem::path& path, const Result& result) {
  return path.extension() == ".json" ? JsonText(ToJson(result.poses, result.pose_names))
                                     : ToCsv(result.poses, result.pose_names);
}

TrajectoryErrors MeasureTrajectory(const po::variables_map& arguments,
                                   const TrajectoryErrorOptions& options, Result& result) {
  const std::string estimate_file = Required(arguments, "estimate");
  const std::string ground_truth_file = Required(arguments, "ground-truth");
  const Trajectory estimate = ReadTrajectory(estimate_file);
  const Trajectory ground_truth = ReadTrajectory(ground_truth_file);
  CheckBothHaveTimes(estimate_file, ground_truth_file);
  const auto errors = CompareTrajectories(estimate, ground_truth, options);
  if (!errors) {
    const size_t num_pairs = AssociateByTime(estimate, ground_truth, options.max_dt_s).size();
    ThrowInputError(
        "{}: cannot be compared with {}: {} of {} poses have a counterpart within {} s, or all "
        "lie on one line",
        estimate_file, ground_truth_file, num_pairs, estimate.size(), options.max_dt_s);
  }
  result.Add("trajectory", ToTable(*errors), ToJson(*errors));
  result.poses = errors->poses;
  return *errors;
}

void MeasureModels(const po::variables_map& arguments, const TrajectoryErrorOptions& options,
                   Result& result) {
  const std::string folder = Required(arguments, "model");
  const std::string other_folder = Required(arguments, "other-model");
  const Reconstruction model = ReadColmapModel(folder);
  const Reconstruction other = ReadColmapModel(other_folder);
  const auto difference = CompareModels(model, other, options.align);
  if (!difference) {
    ThrowInputError(
        "{}: cannot be compared with {}: fewer than three images of the same name, or all their "
        "cameras lie on one line",
        folder, other_folder);
  }
  result.Add("models", ToTable(*difference), ToJson(*difference));
  result.poses = difference->poses;
  result.pose_names = difference->names;
}

/// Of the model that s3-refine made this one of, by the report beside it; empty for other models.
std::optional<std::string> FingerprintBeforeRefinement(const std::filesystem::path& model) {
  const std::filesystem::path report = model / "report.json";
  if (!std::filesystem::exists(report)) return std::nullopt;
  const nlohmann::json document = ReadJson(report);
  if (!document.is_object()) return std::nullopt;
  const auto fingerprint = document.find("input_model_fingerprint");
  if (fingerprint == document.end() || !fingerprint->is_string()) return std::nullopt;
  return fingerprint->get<std::string>();
}

/// The semantic map of the model. One of the model before its refinement will do, which kept the
/// ids of the points: that is how maps before and after are compared.
SemanticMap ReadSemantics(const std::string& directory, const Reconstruction& model,
                          const std::filesystem::path& model_directory) {
  SemanticMap map = ReadSemanticMap(directory);
  if (FingerprintBeforeRefinement(model_directory) != map.model_fingerprint) {
    CheckMadeFromModel(map, FingerprintOfModel(model), directory);
  }
  return map;
}

std::vector<PlaneCloud> MeasureClouds(const po::variables_map& arguments,
                                      const Similarity3& truth_from_estimate, Result& result) {
  const std::string model_directory = Required(arguments, "model");
  const Reconstruction model = ReadColmapModel(model_directory);
  const SemanticMap map = ReadSemantics(Required(arguments, "semantics"), model, model_directory);
  auto clouds = MeasurePlaneClouds(model, map, truth_from_estimate.scale);
  if (clouds.empty()) {
    ThrowInputError("{}: no plane has points in {}", arguments["semantics"].as<std::string>(),
                    model_directory);
  }
  result.Add("cloud", ToTable(clouds), ToJson(clouds));
  return clouds;
}

void MeasureAngles(const po::variables_map& arguments, const std::string& file,
                   const nlohmann::json& document, Result& result) {
  std::vector<std::string> labels;
  if (arguments.count("plane-class") > 0) {
    labels = arguments["plane-class"].as<std::vector<std::string>>();
  }
  const auto pairs = PairwisePlaneAngles(LabelledNormalsFromJson(document, file), labels);
  result.Add("planes", ToTable(pairs), ToJson(pairs));
}

std::map<int, std::string> ClassNames(const po::variables_map& arguments) {
  std::map<int, std::string> names;
  if (arguments.count("classes") == 0) return names;
  for (const SemanticClass& c :
       ReadClassTable(FindConfigFile(Required(arguments, "classes"), "classes")).classes) {
    names[c.id] = c.name;
  }
  return names;
}

void MeasureKnownPlanes(const po::variables_map& arguments, const PlaneErrorOptions& options,
                        const std::vector<FittedPlane>& fitted,
                        const Similarity3& truth_from_estimate, Result& result) {
  const std::string file = Required(arguments, "known-planes");
  const auto known =
      KnownPlanesFromJson(ReadJson(file), options.frame, ClassNames(arguments), file);
  const PlaneErrors errors = ComparePlanes(known, fitted, truth_from_estimate, options);
  result.Add("known_planes", ToTable(errors), ToJson(errors));
}

/// "auto" or a number.
void ReadTimeOffset(const std::string& text, TrajectoryErrorOptions& options) {
  options.estimate_time_offset = text == "auto";
  if (options.estimate_time_offset) return;
  char* end = nullptr;
  options.time_offset_s = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !std::isfinite(options.time_offset_s)) {
    throw UsageError(fmt::format("--time-offset {}: expected auto or seconds", text));
  }
}

/// The configuration, and over it the arguments that name the same things.
EvalOptions ReadOptions(const po::variables_map& arguments, const CommonArguments& common) {
  auto options = LoadOptions<EvalOptions>(common);
  if (arguments.count("align") > 0) {
    const std::string name = arguments["align"].as<std::string>();
    const auto align = TrajectoryAlignmentFromName(name);
    if (!align) throw UsageError(fmt::format("--align {}: expected sim3, se3 or none", name));
    options.trajectory.align = *align;
  }
  if (arguments.count("max-dt") > 0) {
    options.trajectory.max_dt_s = arguments["max-dt"].as<double>();
  }
  if (arguments.count("time-offset") > 0) {
    ReadTimeOffset(arguments["time-offset"].as<std::string>(), options.trajectory);
  }
  CheckOptions(options);
  for (const double length : options.trajectory.segment_lengths_m) {
    if (!(length > 0.0)) throw UsageError("segment_lengths_m: lengths must be positive");
  }
  return options;
}

/// What the arguments ask for.
struct Wanted {
  bool trajectory = false;
  bool planes = false;
  bool clouds = false;
  bool models = false;
  bool known_planes = false;
};

Wanted ReadWanted(const po::variables_map& arguments) {
  const auto given = [&](const char* name) { return arguments.count(name) > 0; };
  Wanted wanted;
  wanted.planes = given("planes");
  wanted.clouds = given("semantics");
  wanted.models = given("other-model");
  wanted.known_planes = given("known-planes");
  const bool other = wanted.planes || wanted.clouds || wanted.models;
  wanted.trajectory = given("estimate") || given("ground-truth") || !other;
  if (wanted.known_planes && !wanted.planes && !wanted.clouds) {
    throw UsageError("--known-planes needs --planes, or --model and --semantics");
  }
  if (given("model") && !wanted.clouds && !wanted.models) {
    throw UsageError("--model needs --semantics or --other-model");
  }
  if (given("per-pose") && !wanted.trajectory && !wanted.models) {
    throw UsageError(
        "--per-pose needs --estimate and --ground-truth, or --model and --other-model");
  }
  if (given("per-pose") && wanted.trajectory && wanted.models) {
    throw UsageError("--per-pose: of the trajectory or of the two models, not of both");
  }
  return wanted;
}

void Run(const po::variables_map& arguments, const CommonArguments& common) {
  const EvalOptions options = ReadOptions(arguments, common);
  const Wanted wanted = ReadWanted(arguments);
  std::optional<OutputFile> per_pose = OpenPerPose(arguments, common.overwrite);
  Result result;
  Similarity3 truth_from_estimate;
  if (wanted.trajectory) {
    truth_from_estimate =
        MeasureTrajectory(arguments, options.trajectory, result).truth_from_estimate;
  }
  if (wanted.models) MeasureModels(arguments, options.trajectory, result);
  std::vector<FittedPlane> fitted;
  if (wanted.clouds) fitted = BestPlanes(MeasureClouds(arguments, truth_from_estimate, result));
  if (wanted.planes) {
    const std::string file = Required(arguments, "planes");
    const nlohmann::json document = ReadJson(file);
    MeasureAngles(arguments, file, document, result);
    if (wanted.known_planes) fitted = FittedPlanesFromJson(document, file);
  }
  if (wanted.known_planes) {
    MeasureKnownPlanes(arguments, options.planes, fitted, truth_from_estimate, result);
  }
  if (per_pose) per_pose->Commit(PosesText(Required(arguments, "per-pose"), result));
  PrintReport(common, result.table, result.json);
}

}  // namespace
}  // namespace s3lam::tools

int main(int argc, char** argv) {
  namespace po = boost::program_options;
  s3lam::tools::Program program;
  program.name = "s3-eval";
  program.description = s3lam::tools::kDescription;
  auto add = program.arguments.add_options();
  add("estimate", po::value<std::string>()->value_name("FILE"), "estimated trajectory");
  add("ground-truth", po::value<std::string>()->value_name("FILE"), "true trajectory");
  add("align", po::value<std::string>()->value_name("sim3|se3|none"),
      "what is aligned first (default sim3)");
  add("max-dt", po::value<double>()->value_name("SECONDS"),
      "largest time difference of associated poses (default 0.02)");
  add("time-offset", po::value<std::string>()->value_name("auto|SECONDS"),
      "how far the clock of the ground truth is ahead, estimated or given (default 0): poses are "
      "compared with the ground truth interpolated at their time + offset");
  add("planes", po::value<std::string>()->value_name("FILE"), "planes to compare with one another");
  add("plane-class", po::value<std::vector<std::string>>()->composing()->value_name("NAME"),
      "only planes of this class; may be repeated");
  add("known-planes", po::value<std::string>()->value_name("FILE"),
      "objects.json with the planes that are there");
  add("classes", po::value<std::string>()->value_name("FILE"),
      "class table that names the classes of --known-planes");
  add("model", po::value<std::string>()->value_name("DIR"), "COLMAP model");
  add("semantics", po::value<std::string>()->value_name("DIR"),
      "output of s3-lift that says which points of --model lie on which plane");
  add("other-model", po::value<std::string>()->value_name("DIR"),
      "COLMAP model to compare --model with");
  add("per-pose", po::value<std::string>()->value_name("FILE"),
      "write the errors of every pose, as .csv or .json");
  s3lam::tools::SetConfiguration(s3lam::tools::EvalOptions(), program);
  program.run = s3lam::tools::Run;
  program.outputs = {"per-pose"};
  return s3lam::tools::RunProgram(argc, argv, program);
}
