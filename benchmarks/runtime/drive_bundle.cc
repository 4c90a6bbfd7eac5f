// Bundle adjustment of synthetic drives of any size: time and memory.

#include <fmt/format.h>

#include <ctime>
#include <filesystem>

#include "common/program.h"
#include "runtime/drive.h"
#include "s3lam/base/error.h"
#include "s3lam/base/output_directory.h"
#include "s3lam/base/timer.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/refine/bundle_solver.h"
#include "s3lam/refine/problem_builder.h"

namespace s3lam::tools {
namespace {

namespace po = boost::program_options;

void AddPlanes(const benchmarks::Drive& drive, BundleMap& map) {
  map.problem.planes = drive.planes;
  for (const auto& [id, plane] : drive.plane_of_point) {
    map.problem.points_on_planes.push_back({map.IndexOfPoint(id), plane, 0.05});
  }
}

void Run(const po::variables_map& arguments, const CommonArguments& common) {
  const int num_keyframes = arguments["keyframes"].as<int>();
  if (num_keyframes < 10) throw UsageError("--keyframes must be at least 10");
  const int points_per_keyframe = arguments["points-per-keyframe"].as<int>();
  if (points_per_keyframe < 10) throw UsageError("--points-per-keyframe must be at least 10");
  benchmarks::Drive drive = benchmarks::MakeDrive(num_keyframes, points_per_keyframe, common.seed);
  benchmarks::Perturb(common.seed, drive.model);
  nlohmann::json report{{"keyframes", drive.model.images.size()},
                        {"points", drive.model.points.size()},
                        {"observations", drive.model.NumObservations()}};
  if (arguments.count("output") > 0) {
    OutputDirectory directory(arguments["output"].as<std::string>(), common.overwrite);
    WriteColmapModel(drive.model, directory.path());
    directory.Commit();
    PrintReport(common, report.dump() + "\n", report);
    return;
  }
  auto options = LoadOptions<BundleSolverOptions>(common);
  options.num_threads = common.threads;
  BundleMap map = BuildBundleMap(drive.model);
  SelectObservations(OutlierOptions(), options.sigma_px, true, map);
  map.problem.gauge = ChooseGauge(map.problem);
  const std::string arm = arguments["arm"].as<std::string>();
  if (arm == "planes") AddPlanes(drive, map);
  drive = {};
  map.elements.clear();
  report["arm"] = arm;
  report["start_memory_mib"] = PeakMemoryMiB();
  const Timer timer;
  const std::clock_t cpu = std::clock();
  const BundleSolverReport solve = SolveBundle(options, map.problem);
  report["seconds"] = timer.Seconds();
  report["cpu_seconds"] = static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC;
  report["iterations"] = solve.num_iterations;
  report["initial_cost"] = solve.initial_cost;
  report["final_cost"] = solve.final_cost;
  report["converged"] = solve.converged;
  report["linear_solver"] = solve.linear_solver;
  report["peak_memory_mib"] = PeakMemoryMiB();
  PrintReport(common, report.dump() + "\n", report);
}

}  // namespace
}  // namespace s3lam::tools

int main(int argc, char** argv) {
  using namespace s3lam;
  namespace po = boost::program_options;
  tools::Program program;
  program.name = "s3-drive";
  program.description =
      "Makes a synthetic drive whose points, camera centres and rotations are off by 1 % of the\n"
      "median depth and 0.3 deg, and adjusts it: one line of JSON with time and memory.\n"
      "With --output it only writes the COLMAP model.";
  auto add = program.arguments.add_options();
  add("keyframes", po::value<int>()->default_value(200), "number of keyframes");
  add("points-per-keyframe", po::value<int>()->default_value(200), "points for each of them");
  add("arm", po::value<std::string>()->default_value("plain"), "plain or planes");
  add("output", po::value<std::string>()->value_name("DIR"), "folder to write");
  tools::SetConfiguration(BundleSolverOptions(), program);
  program.run = tools::Run;
  return tools::RunProgram(argc, argv, program);
}
