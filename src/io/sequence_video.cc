#include <fmt/format.h>

#include <opencv2/videoio.hpp>

#include "s3lam/base/error.h"
#include "sequence_formats.h"

namespace s3lam::internal {

ImageSequence OpenVideo(const std::filesystem::path& path) {
  cv::VideoCapture capture;
  if (!capture.open(path.string()) || !capture.isOpened()) {
    ThrowInputError("{}: not a video that can be opened", path.string());
  }
  ImageSequence sequence;
  sequence.format = SequenceFormat::kVideo;
  sequence.image_root = path;
  // The container's frame count is an estimate: count what can be decoded.
  bool stamps_increase = true;
  double last_s = -1.0;
  for (int index = 0; capture.grab(); ++index) {
    const double time_s = 1e-3 * capture.get(cv::CAP_PROP_POS_MSEC);
    stamps_increase = stamps_increase && time_s > last_s;
    last_s = time_s;
    sequence.frames.push_back(
        {time_s, fmt::format("{}_{:06d}.png", path.stem().string(), index), {}, index});
  }
  if (sequence.frames.empty()) ThrowInputError("{}: the video has no frames", path.string());
  if (!stamps_increase) {
    const double fps = capture.get(cv::CAP_PROP_FPS);
    const double period_s = fps > 0.0 ? 1.0 / fps : kDefaultPeriodS;
    for (SequenceFrame& frame : sequence.frames) frame.time_s = frame.index * period_s;
  }
  return sequence;
}

}  // namespace s3lam::internal
