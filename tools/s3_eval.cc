#include <fmt/format.h>

#include <boost/program_options.hpp>
#include <nlohmann/json.hpp>

#include "common/program.h"
#include "s3lam/base/error.h"
#include "s3lam/eval/plane_angles.h"
#include "s3lam/eval/trajectory_error.h"
#include "s3lam/io/file.h"
#include "s3lam/io/trajectory.h"

namespace s3lam::tools {
namespace {

namespace po = boost::program_options;

constexpr const char* kDescription =
    "Compares a trajectory with the ground truth, and planes with one another.\n\n"
    "Reads   --estimate and --ground-truth: TUM (time tx ty tz qx qy qz qw) or KITTI (3x4\n"
    "        matrices), world_from_camera; --planes: semantics.json or planes.json.\n"
    "Writes  to standard output: absolute trajectory error (ATE) after alignment, relative pose\n"
    "        error (RPE) over consecutive poses, angles between planes. Lengths are in the ground\n"
    "        truth's unit.";

struct Result {
  std::string table;
  nlohmann::json json = nlohmann::json::object();
};

void CompareFiles(const std::string& estimate_file, const std::string& ground_truth_file,
                  const TrajectoryErrorOptions& options, Result& result) {
  const Trajectory estimate = ReadTrajectory(estimate_file);
  const Trajectory ground_truth = ReadTrajectory(ground_truth_file);
  const auto errors = CompareTrajectories(estimate, ground_truth, options);
  if (!errors) {
    const size_t num_pairs = AssociateByTime(estimate, ground_truth, options.max_dt_s).size();
    ThrowInputError(
        "{}: cannot be compared with {}: {} of {} poses have a counterpart within {} s, or all "
        "lie on one line",
        estimate_file, ground_truth_file, num_pairs, estimate.size(), options.max_dt_s);
  }
  result.table += ToTable(*errors);
  result.json["trajectory"] = ToJson(*errors);
}

void ComparePlanes(const std::string& file, const std::vector<std::string>& labels,
                   Result& result) {
  const auto planes = LabelledNormalsFromJson(ReadJson(file), file);
  const auto pairs = PairwisePlaneAngles(planes, labels);
  if (!result.table.empty()) result.table += "\n";
  result.table += ToTable(pairs);
  result.json["planes"] = ToJson(pairs);
}

/// The configuration, and over it the arguments that name the same things.
TrajectoryErrorOptions ReadOptions(const po::variables_map& arguments,
                                   const CommonArguments& common) {
  auto options = LoadOptions<TrajectoryErrorOptions>(common);
  if (arguments.count("align") > 0) {
    const std::string name = arguments["align"].as<std::string>();
    const auto align = TrajectoryAlignmentFromName(name);
    if (!align) throw UsageError(fmt::format("--align {}: expected sim3, se3 or none", name));
    options.align = *align;
  }
  if (arguments.count("max-dt") > 0) options.max_dt_s = arguments["max-dt"].as<double>();
  CheckOptions(options);
  return options;
}

void Run(const po::variables_map& arguments, const CommonArguments& common) {
  const TrajectoryErrorOptions options = ReadOptions(arguments, common);
  const bool has_planes = arguments.count("planes") > 0;
  const bool has_trajectory =
      arguments.count("estimate") > 0 || arguments.count("ground-truth") > 0;
  Result result;
  if (has_trajectory || !has_planes) {
    CompareFiles(Required(arguments, "estimate"), Required(arguments, "ground-truth"), options,
                 result);
  }
  if (has_planes) {
    std::vector<std::string> labels;
    if (arguments.count("plane-class") > 0) {
      labels = arguments["plane-class"].as<std::vector<std::string>>();
    }
    ComparePlanes(Required(arguments, "planes"), labels, result);
  }
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
  add("planes", po::value<std::string>()->value_name("FILE"), "planes to compare with one another");
  add("plane-class", po::value<std::vector<std::string>>()->composing()->value_name("NAME"),
      "only planes of this class; may be repeated");
  s3lam::tools::SetConfiguration(s3lam::TrajectoryErrorOptions(), program);
  program.run = s3lam::tools::Run;
  return s3lam::tools::RunProgram(argc, argv, program);
}
