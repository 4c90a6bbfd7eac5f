#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/base/parallel.h"
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

/// Of the sizes that are not empty, one at least; the first of several that are as frequent.
cv::Size MostFrequentSize(const std::vector<cv::Size>& sizes) {
  cv::Size best;
  std::map<std::pair<int, int>, int> counts;
  for (const cv::Size& size : sizes) {
    if (!size.empty()) ++counts[{size.width, size.height}];
  }
  int most = 0;
  for (const cv::Size& size : sizes) {
    const int count = size.empty() ? 0 : counts[{size.width, size.height}];
    if (count > most) best = size;
    most = std::max(most, count);
  }
  return best;
}

/// Bits that the values of 16-bit images use: those of a sensor of 10, 12 or 14 bits often stand in
/// the lower ones, and would be nearly black.
int UsedBits(double largest) {
  for (const int bits : {8, 10, 12, 14}) {
    if (largest < static_cast<double>(1 << bits)) return bits;
  }
  return 16;
}

}  // namespace

struct FrameReader::Impl {
  ImageSequence sequence;
  std::unique_ptr<VideoReader> video;
  std::once_flag scale_is_known;
  double scale = 1.0 / 256.0;  // Of 16-bit images, the same for the whole sequence.

  cv::Mat Read(size_t frame_index, int imread_flags) {
    const SequenceFrame& frame = sequence.frames.at(frame_index);
    cv::Mat image = video ? video->Read(frame.index) : ReadImage(frame.path, imread_flags);
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

  cv::Mat ReadImage(const std::filesystem::path& path, int imread_flags) {
    cv::Mat image = ReadImageFile(path, imread_flags | cv::IMREAD_ANYDEPTH);
    if (image.depth() == CV_8U) return image;
    if (image.depth() != CV_16U) return ReadImageFile(path, imread_flags);
    std::call_once(scale_is_known, [&] { FindScale(); });
    // Without rounding: of full 16 bits, the upper eight.
    image.convertTo(image, CV_8U, scale, -0.5 + 0.5 * scale);
    return image;
  }

  /// From some frames of the whole sequence; those that cannot be read say so when they are due.
  void FindScale() {
    constexpr size_t kSamples = 8;
    double largest = 0.0;
    for (size_t i = 0; i < kSamples; ++i) {
      const size_t index = i * (sequence.frames.size() - 1) / (kSamples - 1);
      try {
        const cv::Mat image =
            ReadImageFile(sequence.frames[index].path, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
        if (image.depth() != CV_16U) continue;
        double max = 0.0;
        cv::minMaxLoc(image, nullptr, &max);
        largest = std::max(largest, max);
      } catch (const InputError&) {
        continue;
      }
    }
    const int bits = UsedBits(largest);
    scale = std::exp2(8 - bits);
    if (bits < 16) spdlog::info("16-bit images are taken as of {} bits", bits);
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

std::vector<std::string> LeaveOutUnusable(int num_threads, ImageSequence& sequence) {
  const FrameReader reader(sequence);
  std::vector<cv::Size> sizes(sequence.frames.size());
  std::vector<std::string> faults(sequence.frames.size());
  ParallelFor(sizes.size(), reader.IsThreadSafe() ? num_threads : 1, [&](size_t i) {
    try {
      sizes[i] = reader.ReadGray(i).size();
    } catch (const InputError& error) {
      faults[i] = error.what();
    }
  });
  const auto is_usable = [](const std::string& fault) { return fault.empty(); };
  if (std::none_of(faults.begin(), faults.end(), is_usable)) throw InputError(faults.front());
  const cv::Size expected = MostFrequentSize(sizes);
  std::vector<SequenceFrame> usable;
  std::vector<std::string> found;
  for (size_t i = 0; i < faults.size(); ++i) {
    const SequenceFrame& frame = sequence.frames[i];
    if (faults[i].empty() && sizes[i] != expected) {
      faults[i] = fmt::format("{}: image of {} x {} px, but others are of {} x {}", frame.name,
                              sizes[i].width, sizes[i].height, expected.width, expected.height);
    }
    if (faults[i].empty()) {
      usable.push_back(frame);
    } else {
      found.push_back(std::move(faults[i]));
    }
  }
  sequence.frames = std::move(usable);
  return found;
}

}  // namespace s3lam
