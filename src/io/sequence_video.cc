#include <cstdlib>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/videoio.hpp>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "sequence_formats.h"
#include "video_capture.h"

namespace s3lam {
namespace {

/// OpenCV and FFmpeg write what they think of a file to stderr, line after line; what is wrong with
/// it is said once, by the exception. A user's own choice of their log levels stands.
void SilenceDecoders() {
  constexpr const char* kFfmpegQuiet = "-8";  // AV_LOG_QUIET
  setenv("OPENCV_FFMPEG_LOGLEVEL", kFfmpegQuiet, 0);
  if (std::getenv("OPENCV_LOG_LEVEL") == nullptr) {
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  }
}

/// The container's count is an estimate where it is made from duration and frame rate.
void WarnIfCutShort(const std::string& source, double announced, size_t decoded) {
  constexpr double kEstimate = 0.95;
  if (static_cast<double>(decoded) >= kEstimate * announced) return;
  spdlog::warn("{}: the video announces {:.0f} frames, but only {} can be decoded: is it whole?",
               source, announced, decoded);
}

ImageSequence OpenVideo(const std::filesystem::path& path) {
  SilenceDecoders();
  cv::VideoCapture capture;
  if (!internal::OpenVideoFile(path, capture)) {
    ThrowInputError("{}: not a video that can be opened", path.string());
  }
  ImageSequence sequence;
  sequence.format = SequenceFormat::kVideo;
  sequence.image_root = path;
  bool stamps_increase = true;
  double last_s = -1.0;
  for (int index = 0; capture.grab(); ++index) {
    const double time_s = 1e-3 * capture.get(cv::CAP_PROP_POS_MSEC);
    stamps_increase = stamps_increase && time_s > last_s;
    last_s = time_s;
    sequence.frames.push_back({time_s, NameOfVideoFrame(path, index), {}, index});
  }
  if (sequence.frames.empty()) ThrowInputError("{}: the video has no frames", path.string());
  WarnIfCutShort(path.string(), capture.get(cv::CAP_PROP_FRAME_COUNT), sequence.frames.size());
  if (!stamps_increase) {
    const double fps = capture.get(cv::CAP_PROP_FPS);
    const double period_s = fps > 0.0 ? 1.0 / fps : internal::kDefaultPeriodS;
    for (SequenceFrame& frame : sequence.frames) frame.time_s = frame.index * period_s;
  }
  return sequence;
}

}  // namespace

ImageSequence OpenSequence(const std::filesystem::path& path, SequenceFormat format,
                           const FrameRange& range, OwnCamera camera, MissingImages missing) {
  return OpenSequence(path, format, range, OpenVideo, camera, missing);
}

}  // namespace s3lam
