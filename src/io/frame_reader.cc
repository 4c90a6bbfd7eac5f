#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "s3lam/base/error.h"
#include "s3lam/io/image_file.h"
#include "s3lam/io/image_sequence.h"
#include "video_capture.h"

namespace s3lam {
namespace {

/// Decodes a video forwards; a frame behind the last one means opening it again, because seeking is
/// not exact for many codecs.
class VideoReader {
 public:
  explicit VideoReader(const std::filesystem::path& path) : source_(path.string()) {}

  cv::Mat Read(int index) {
    if (next_ < 0 || index < next_) Open();
    for (; next_ < index; ++next_) Grab(next_);
    Grab(next_++);
    cv::Mat image;
    if (!capture_.retrieve(image) || image.empty()) Fail(index);
    return image.clone();  // The capture reuses its buffer.
  }

 private:
  void Open() {
    if (!internal::OpenVideoFile(source_, capture_)) {
      ThrowInputError("{}: cannot open video", source_);
    }
    next_ = 0;
  }
  void Grab(int index) {
    if (!capture_.grab()) Fail(index);
  }
  [[noreturn]] void Fail(int index) const {
    ThrowInputError("{}: cannot decode frame {}", source_, index);
  }

  std::string source_;
  cv::VideoCapture capture_;
  int next_ = -1;  // The frame that the next grab gives.
};

}  // namespace

struct FrameReader::Impl {
  ImageSequence sequence;
  std::unique_ptr<VideoReader> video;

  cv::Mat Read(size_t frame_index, int imread_flags) const {
    const SequenceFrame& frame = sequence.frames.at(frame_index);
    cv::Mat image = video ? video->Read(frame.index) : ReadImageFile(frame.path, imread_flags);
    const auto& camera = sequence.camera;
    if (camera && (image.cols != camera->width || image.rows != camera->height)) {
      ThrowInputError(
          "{}: image of {} x {} px, but the camera is for {} x {}: give the calibration of these "
          "images",
          video ? frame.name : frame.path.string(), image.cols, image.rows, camera->width,
          camera->height);
    }
    return image;
  }
};

FrameReader::FrameReader(const ImageSequence& sequence) : impl_(std::make_unique<Impl>()) {
  impl_->sequence = sequence;
  if (sequence.format == SequenceFormat::kVideo) {
    impl_->video = std::make_unique<VideoReader>(sequence.image_root);
  }
}

FrameReader::~FrameReader() = default;

cv::Mat FrameReader::Read(size_t frame_index) const {
  return impl_->Read(frame_index, cv::IMREAD_ANYCOLOR);
}

cv::Mat FrameReader::ReadGray(size_t frame_index) const {
  cv::Mat image = impl_->Read(frame_index, cv::IMREAD_GRAYSCALE);
  if (image.channels() == 3) cv::cvtColor(image, image, cv::COLOR_BGR2GRAY);
  return image;
}

bool FrameReader::IsThreadSafe() const { return impl_->video == nullptr; }

}  // namespace s3lam
