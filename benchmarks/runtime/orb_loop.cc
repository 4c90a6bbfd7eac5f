// The unit in which a whole SLAM run is measured: OpenCV's own ORB, one thread, over the images of
// a sequence held in memory. Prints the seconds that detecting and computing took.

#include <fmt/format.h>

#include <boost/program_options.hpp>
#include <opencv2/features2d.hpp>

#include "common/program.h"
#include "s3lam/base/timer.h"
#include "s3lam/io/image_sequence.h"

namespace s3lam::tools {
namespace {

namespace po = boost::program_options;

void RunLoop(const po::variables_map& arguments, const CommonArguments& /*common*/) {
  const FrameRange range = arguments.count("frames") > 0
                               ? ParseFrameRange(arguments["frames"].as<std::string>())
                               : FrameRange{};
  const ImageSequence sequence =
      OpenSequence(Required(arguments, "sequence"), SequenceFormat::kAuto, range);
  const FrameReader reader(sequence);
  std::vector<cv::Mat> images;
  for (size_t i = 0; i < sequence.frames.size(); ++i) images.push_back(reader.ReadGray(i));
  cv::setNumThreads(1);
  const auto orb = cv::ORB::create(1000, 1.2F, 8);
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;
  size_t count = 0;
  const Timer timer;
  for (const cv::Mat& image : images) {
    orb->detectAndCompute(image, cv::noArray(), keypoints, descriptors);
    count += keypoints.size();
  }
  fmt::print("{{\"images\": {}, \"keypoints\": {}, \"seconds\": {:.4f}}}\n", images.size(), count,
             timer.Seconds());
}

}  // namespace
}  // namespace s3lam::tools

int main(int argc, char** argv) {
  using namespace s3lam::tools;
  namespace po = boost::program_options;
  Program program;
  program.name = "s3-orb-loop";
  program.description = "Times cv::ORB (1000 features, 8 levels) over a sequence, on one thread.";
  auto add = program.arguments.add_options();
  add("sequence", po::value<std::string>()->value_name("DIR|VIDEO"), "the images");
  add("frames", po::value<std::string>()->value_name("A:B:STEP"), "use only these frames");
  program.run = RunLoop;
  return RunProgram(argc, argv, program);
}
