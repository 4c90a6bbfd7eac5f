#include <map>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "id_image.h"
#include "mask_decoders.h"
#include "npy_array.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace fs = std::filesystem;
namespace {

/// Pieces of a thing smaller than this share of the image are not told apart.
constexpr double kMinPieceShare = 5e-5;

/// Class index per pixel, -1 for void, to segments: one per class of stuff, and one per connected
/// piece of a class of things, since nothing tells instances apart.
void SegmentsFromClasses(const IdMatrix& class_of_pixel, const ClassResolver& classes,
                         PanopticFrame& frame) {
  const auto rows = static_cast<int>(class_of_pixel.rows());
  const auto cols = static_cast<int>(class_of_pixel.cols());
  const auto min_area = static_cast<int>(kMinPieceShare * rows * cols);
  frame.segment_ids = SegmentImage::Constant(rows, cols, kNoSegment);
  std::map<int, cv::Mat> mask_of_thing;
  std::map<int, uint32_t> segment_of_class;  // Of stuff, and of the small pieces of things.
  const auto add_segment = [&](int class_index, bool is_crowd) {
    const auto id = static_cast<uint32_t>(frame.segments.size() + 1);
    PanopticSegment segment;
    segment.class_index = class_index;
    segment.is_crowd = is_crowd;
    frame.segments.emplace(id, segment);
    return id;
  };
  const auto whole_class = [&](int class_index) {
    const auto it = segment_of_class.find(class_index);
    if (it != segment_of_class.end()) return it->second;
    return segment_of_class[class_index] = add_segment(class_index, classes.IsThing(class_index));
  };
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < cols; ++x) {
      const int class_index = class_of_pixel(y, x);
      if (class_index < 0) continue;
      if (!classes.IsThing(class_index)) {
        frame.segment_ids(y, x) = whole_class(class_index);
        continue;
      }
      cv::Mat& mask = mask_of_thing[class_index];
      if (mask.empty()) mask = cv::Mat::zeros(rows, cols, CV_8U);
      mask.at<uint8_t>(y, x) = 1;
    }
  }
  for (const auto& [class_index, mask] : mask_of_thing) {
    cv::Mat pieces;
    cv::Mat stats;
    cv::Mat centroids;
    const int count = cv::connectedComponentsWithStats(mask, pieces, stats, centroids);
    std::vector<uint32_t> segment_of_piece(static_cast<size_t>(count), kNoSegment);
    for (int i = 1; i < count; ++i) {
      const bool is_small = stats.at<int>(i, cv::CC_STAT_AREA) < min_area;
      segment_of_piece[static_cast<size_t>(i)] =
          is_small ? whole_class(class_index) : add_segment(class_index, false);
    }
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < cols; ++x) {
        const int piece = pieces.at<int>(y, x);
        if (piece > 0) frame.segment_ids(y, x) = segment_of_piece[static_cast<size_t>(piece)];
      }
    }
  }
}

std::string ReadVolumeFile(const fs::path& path) {
  std::string bytes = ReadFile(path);
  return path.extension() == ".npz" ? ExtractNpz(bytes, path.string()) : bytes;
}

ProbabilityVolume::Type TypeOf(const NpyArray& array, const std::string& source) {
  if (array.type == "f4") return ProbabilityVolume::Type::kFloat32;
  if (array.type == "f2") return ProbabilityVolume::Type::kFloat16;
  if (array.type == "u1") return ProbabilityVolume::Type::kUint8;
  ThrowInputError("{}: items of type {} (wanted f4, f2 or u1)", source, array.type);
}

/// Channel i is label i of the label map or, without one, class i of the table.
std::vector<int> ClassesOfChannels(int channels, const ClassResolver& classes,
                                   const std::string& source) {
  std::vector<int> result(static_cast<size_t>(channels));
  std::iota(result.begin(), result.end(), 0);
  if (!classes.map().IsIdentity()) {
    for (int& c : result) c = classes.IndexOf(c, source).value_or(-1);
  } else if (channels != classes.table().size()) {
    ThrowInputError("{}: {} channels where the class table '{}' has {} classes; give --label-map",
                    source, channels, classes.table().name, classes.table().size());
  }
  return result;
}

}  // namespace

PanopticFrame DecodeLabels(const fs::path& path, const ClassResolver& classes) {
  const IdImage image = ReadIdImage(path);
  std::map<int32_t, int32_t> class_of_label;
  IdMatrix class_of_pixel(image.ids.rows(), image.ids.cols());
  for (Eigen::Index i = 0; i < image.ids.size(); ++i) {
    const int32_t label = image.ids.data()[i];
    auto it = class_of_label.find(label);
    if (it == class_of_label.end()) {
      const bool is_void =
          (label == 0 || label == image.minus_one || label == -1) && !classes.Knows(label);
      const int index = is_void ? -1 : classes.IndexOf(label, path.string()).value_or(-1);
      it = class_of_label.emplace(label, index).first;
    }
    class_of_pixel.data()[i] = it->second;
  }
  PanopticFrame frame{path.string(), {}, {}, {}};
  SegmentsFromClasses(class_of_pixel, classes, frame);
  return frame;
}

PanopticFrame DecodeProbabilities(const fs::path& path, const ClassResolver& classes) {
  const std::string source = path.string();
  NpyArray array = ParseNpy(ReadVolumeFile(path), source);
  constexpr int64_t kMaxSize = 1 << 20;
  const bool fits = array.shape.size() == 3 && array.shape[0] <= kMaxSize &&
                    array.shape[1] <= kMaxSize && array.shape[2] <= kMaxSize;
  if (!fits) {
    ThrowInputError("{}: {} dimensions where channels x rows x columns are due", source,
                    array.shape.size());
  }
  if (array.shape[0] == 0 || array.shape[1] == 0 || array.shape[2] == 0) {
    ThrowInputError("{}: {} channels of {} rows and {} columns: no pixels", source, array.shape[0],
                    array.shape[1], array.shape[2]);
  }
  ProbabilityVolume volume;
  volume.type = TypeOf(array, source);
  volume.channels = static_cast<int>(array.shape[0]);
  volume.rows = static_cast<int>(array.shape[1]);
  volume.cols = static_cast<int>(array.shape[2]);
  volume.offset = array.offset;
  volume.bytes = std::move(array.bytes);
  volume.class_of_channel = ClassesOfChannels(volume.channels, classes, source);
  IdMatrix class_of_pixel = MostLikelyChannels(volume, source);
  for (int32_t& c : class_of_pixel.reshaped<Eigen::RowMajor>()) {
    c = volume.class_of_channel[static_cast<size_t>(c)];
  }
  PanopticFrame frame{source, {}, {}, {}};
  SegmentsFromClasses(class_of_pixel, classes, frame);
  frame.probabilities = std::move(volume);
  return frame;
}

}  // namespace s3lam
