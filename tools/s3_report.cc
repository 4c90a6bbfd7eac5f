#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <optional>

#include "common/program.h"
#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/base/output_directory.h"
#include "s3lam/base/output_file.h"
#include "s3lam/io/trajectory.h"
#include "s3lam/report/pipeline.h"

namespace s3lam::tools {
namespace {

namespace fs = std::filesystem;
namespace po = boost::program_options;

constexpr const char* kDescription =
    "Shows a run of the stages in one HTML file that needs nothing else, and as pictures.\n\n"
    "Reads  --run           folder with 1_slam/, 2_lift/, 3_refine/, 3_refine_plain/ as\n"
    "                       tools/run.sh makes it; what is missing is left out, and said so\n"
    "       --ground-truth  TUM (time tx ty tz qx qy qz qw) or KITTI (3x4 matrices),\n"
    "                       world_from_camera\n"
    "       --images        folder of the images (default: where the run read them)\n"
    "Writes --output        the page: doubts, trust in the frames, 3D view, map, trajectory,\n"
    "                       residuals, keyframes, tables\n"
    "       --png           folder: the plots, views and keyframes of the page as PNG\n"
    "       (one of the two is enough)";

std::string Optional(const po::variables_map& arguments, const char* name) {
  return arguments.count(name) > 0 ? Required(arguments, name) : std::string();
}

void WritePictures(const std::vector<report::Figure>& figures, const fs::path& directory) {
  constexpr double kScaleOfDrawings = 2.0;  // Sharp enough for print.
  for (const report::Figure& figure : figures) {
    const fs::path path = directory / (figure.name + ".png");
    const auto* drawing = std::get_if<Drawing>(&figure.picture);
    const cv::Mat image =
        drawing ? drawing->ToImage(kScaleOfDrawings) : std::get<cv::Mat>(figure.picture);
    if (!cv::imwrite(path.string(), image,
                     {cv::IMWRITE_PNG_COMPRESSION, 9, cv::IMWRITE_PNG_STRATEGY,
                      cv::IMWRITE_PNG_STRATEGY_DEFAULT})) {
      throw std::runtime_error(fmt::format("{}: cannot write", path.string()));
    }
  }
}

void MakeReport(const po::variables_map& arguments, const CommonArguments& common) {
  const std::string page = Optional(arguments, "output");
  const std::string pictures = Optional(arguments, "png");
  const std::string ground_truth = Optional(arguments, "ground-truth");
  const fs::path run = Required(arguments, "run");
  if (page.empty() && pictures.empty()) {
    throw UsageError("--output or --png is required (see --help)");
  }
  const auto options = LoadOptions<report::Options>(common);
  std::optional<OutputFile> file;
  std::optional<OutputDirectory> directory;
  if (!page.empty()) file.emplace(page, common.overwrite);
  if (!pictures.empty()) directory.emplace(pictures, common.overwrite);

  report::Input input;
  input.run = report::ReadRunFolder(run);
  if (!ground_truth.empty()) {
    input.truth = ReadTrajectory(ground_truth);
    if (IsTrajectoryWithoutTimes(ground_truth)) {
      ThrowInputError("{}: KITTI's poses have no times: put the sequence's times.txt beside it",
                      ground_truth);
    }
  }
  input.image_directory = Optional(arguments, "images");
  report::Output output;
  const report::Report report = report::Run(options, input, output);
  if (directory) {
    WritePictures(output.figures, directory->path());
    directory->Commit();
  }
  if (file) file->Commit(output.html);
  PrintReport(common, ToText(report), ToJson(report));
}

}  // namespace
}  // namespace s3lam::tools

int main(int argc, char** argv) {
  using namespace s3lam;
  namespace po = boost::program_options;
  tools::Program program{
      "s3-report",       tools::kDescription, po::options_description("Arguments"), {}, {},
      tools::MakeReport, {"output", "png"}};
  auto add = program.arguments.add_options();
  add("run", po::value<std::string>()->value_name("DIR"), "folder of a run");
  add("ground-truth", po::value<std::string>()->value_name("FILE"), "true trajectory");
  add("images", po::value<std::string>()->value_name("DIR"), "folder of the images");
  add("output", po::value<std::string>()->value_name("FILE"), "page to write (.html)");
  add("png", po::value<std::string>()->value_name("DIR"), "folder of pictures to write");
  tools::SetConfiguration(report::Options(), program);
  return tools::RunProgram(argc, argv, program);
}
