// A start for bundle adjustment with work left to do, and the measure of where one ended.

#include <fmt/format.h>

#include <filesystem>

#include "common/program.h"
#include "runtime/drive.h"
#include "s3lam/base/output_directory.h"
#include "s3lam/io/colmap_model.h"

namespace s3lam::tools {
namespace {

namespace po = boost::program_options;

void Run(const po::variables_map& arguments, const CommonArguments& common) {
  Reconstruction model = ReadColmapModel(Required(arguments, "model"));
  if (arguments.count("output") > 0) {
    benchmarks::Perturb(common.seed, model);
    OutputDirectory directory(arguments["output"].as<std::string>(), common.overwrite);
    WriteColmapModel(model, directory.path());
    directory.Commit();
  }
  const ReprojectionStatistics statistics = ComputeReprojectionStatistics(model);
  const nlohmann::json report{{"images", model.images.size()},
                              {"points", model.points.size()},
                              {"observations", model.NumObservations()},
                              {"rms_px", statistics.rms_px},
                              {"behind", statistics.num_behind}};
  PrintReport(common, report.dump() + "\n", report);
}

}  // namespace
}  // namespace s3lam::tools

int main(int argc, char** argv) {
  using namespace s3lam;
  namespace po = boost::program_options;
  tools::Program program;
  program.name = "s3-perturb";
  program.description =
      "Moves the points and camera centres of a COLMAP model by 1 % of its median depth and turns\n"
      "its cameras by 0.3 deg (standard deviations), and prints the model's reprojection error.\n"
      "Without --output it only prints.";
  auto add = program.arguments.add_options();
  add("model", po::value<std::string>()->value_name("DIR"), "COLMAP model");
  add("output", po::value<std::string>()->value_name("DIR"), "folder to write");
  program.run = tools::Run;
  return tools::RunProgram(argc, argv, program);
}
