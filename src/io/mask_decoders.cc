#include "mask_decoders.h"

#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <opencv2/core/mat.hpp>
#include <utility>

#include "colour_png.h"
#include "id_image.h"
#include "png_mask.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace fs = std::filesystem;
namespace {

constexpr uint32_t kKittiVoidClass = 255;
constexpr int kVoidClass = -1;

/// R + 256 G + 65536 B of every pixel of a colour mask.
SegmentImage ReadColours(const fs::path& path) {
  const std::string bytes = ReadFile(path);
  CheckPngIsComplete(bytes, path.string());
  if (auto colours = DecodeColourPng(bytes)) return *std::move(colours);
  const cv::Mat bgr = DecodePngMask(bytes, path.string());
  if (bgr.depth() != CV_8U || bgr.channels() < 3) {
    ThrowInputError("{}: expected an RGB mask of 8 bits, got {} channel(s) of {} bits",
                    path.string(), bgr.channels(), 8 * bgr.elemSize1());
  }
  return IdsFromColours(bgr);
}

/// Segment ids of a colour mask: R + 256 G + 65536 B, passed through `segment_of_colour` once per
/// run of equal pixels.
template <typename SegmentOfColour>
SegmentImage ReadColourSegments(const fs::path& path, const SegmentOfColour& segment_of_colour) {
  SegmentImage pixels = ReadColours(path);
  constexpr std::ptrdiff_t kRun = 16;  // Pixels that are compared together.
  uint32_t last_colour = kNoSegment;
  uint32_t last_id = kNoSegment;
  uint32_t* const end = pixels.data() + pixels.size();
  for (uint32_t* pixel = pixels.data(); pixel != end;) {
    if (end - pixel >= kRun) {
      uint32_t difference = 0;
      for (std::ptrdiff_t i = 0; i < kRun; ++i) difference |= pixel[i] ^ last_colour;
      if (difference == 0) {
        if (last_id != last_colour) std::fill_n(pixel, kRun, last_id);
        pixel += kRun;
        continue;
      }
    }
    for (uint32_t* const stop = pixel + std::min(kRun, end - pixel); pixel != stop; ++pixel) {
      if (*pixel != last_colour) {
        last_colour = *pixel;
        last_id = segment_of_colour(last_colour);
      }
      *pixel = last_id;
    }
  }
  return pixels;
}

/// The same for an image of ids.
template <typename SegmentOfId>
SegmentImage SegmentsFromIds(const IdMatrix& image, const SegmentOfId& segment_of_id) {
  SegmentImage segments(image.rows(), image.cols());
  int32_t last_id = 0;
  uint32_t last_segment = kNoSegment;
  for (Eigen::Index i = 0; i < image.size(); ++i) {
    const int32_t id = image.data()[i];
    if (i == 0 || id != last_id) {
      last_id = id;
      last_segment = segment_of_id(id);
    }
    segments.data()[i] = last_segment;
  }
  return segments;
}

/// Between two ids lie ids of other segments, or of none.
constexpr const char* kInterpolationHint =
    "; was the mask resized with interpolation? ids can only be resized by nearest pixel";

/// True for the values that commonly stand for void where nothing says what they are.
bool MayBeVoid(const IdImage& image, int32_t id) {
  return id == 0 || id == -1 || id == image.minus_one;
}

}  // namespace

PanopticFrame DecodeCoco(const fs::path& path, const CocoAnnotation& annotation) {
  if (!annotation.defect.empty()) throw InputError(annotation.defect);
  const SegmentTable& table = annotation.table;
  PanopticFrame frame{path.string(), {}, table.segments, {}};
  frame.segment_ids = ReadColourSegments(path, [&](uint32_t colour) {
    if (colour == 0 || table.void_segments.contains(colour)) return kNoSegment;
    if (!table.segments.contains(colour)) {
      ThrowInputError("{}: segment {} is not in the JSON{}", path.string(), colour,
                      kInterpolationHint);
    }
    return colour;
  });
  return frame;
}

PanopticFrame DecodeKittiStep(const fs::path& path, const ClassResolver& classes) {
  PanopticFrame frame{path.string(), {}, {}, {}};
  frame.segment_ids = ReadColourSegments(path, [&](uint32_t colour) {
    const uint32_t label = colour & 0xffU;
    if (label == kKittiVoidClass && !classes.Knows(label)) return kNoSegment;
    const std::optional<int> index = classes.IndexOf(label, path.string());
    if (!index) return kNoSegment;
    PanopticSegment segment;
    segment.class_index = *index;
    segment.is_crowd = classes.IsThing(*index) && colour >> 8 == 0;
    frame.segments.emplace(colour, segment);
    return colour;
  });
  return frame;
}

PanopticFrame DecodeDivided(const fs::path& path, const ClassResolver& classes, int divisor,
                            bool plain_below_divisor) {
  const IdImage image = ReadIdImage(path);
  if (image.minus_one == 255) {
    ThrowInputError("{}: 8 bits a pixel where ids as class x {} + instance need 16", path.string(),
                    divisor);
  }
  PanopticFrame frame{path.string(), {}, {}, {}};
  frame.segment_ids = SegmentsFromIds(image.ids, [&](int32_t id) {
    if (id == -1 || id == image.minus_one) return kNoSegment;
    if (id < 0) ThrowInputError("{}: negative id {}", path.string(), id);
    const bool is_plain = plain_below_divisor && id < divisor;
    const std::optional<int> index = classes.IndexOf(is_plain ? id : id / divisor, path.string());
    if (!index) return kNoSegment;
    PanopticSegment segment;
    segment.class_index = *index;
    segment.is_crowd = is_plain && classes.IsThing(*index);
    frame.segments.emplace(static_cast<uint32_t>(id), segment);
    return static_cast<uint32_t>(id);
  });
  return frame;
}

PanopticFrame DecodeScanNet(const fs::path& labels, const fs::path& instances,
                            const ClassResolver& classes) {
  const IdImage label_image = ReadIdImage(labels);
  const IdImage instance_image = ReadIdImage(instances);
  const IdMatrix& label_ids = label_image.ids;
  const IdMatrix& instance_ids = instance_image.ids;
  if (label_ids.rows() != instance_ids.rows() || label_ids.cols() != instance_ids.cols()) {
    ThrowInputError("{}: {} x {} px, but its labels {} have {} x {} px", instances.string(),
                    instance_ids.cols(), instance_ids.rows(), labels.string(), label_ids.cols(),
                    label_ids.rows());
  }
  PanopticFrame frame{labels.string(), {}, {}, {}};
  frame.segment_ids = SegmentImage::Constant(label_ids.rows(), label_ids.cols(), kNoSegment);
  std::map<std::pair<int32_t, int32_t>, uint32_t> segment_of;
  for (Eigen::Index i = 0; i < label_ids.size(); ++i) {
    const std::pair<int32_t, int32_t> key(label_ids.data()[i], instance_ids.data()[i]);
    auto it = segment_of.find(key);
    if (it == segment_of.end()) {
      const bool is_void = key.first == 0 && !classes.Knows(0);
      const int index =
          is_void ? kVoidClass : classes.IndexOf(key.first, labels.string()).value_or(kVoidClass);
      it = segment_of.emplace(key, kNoSegment).first;
      if (index != kVoidClass) {
        it->second = static_cast<uint32_t>(segment_of.size());
        PanopticSegment segment;
        segment.class_index = index;
        segment.is_crowd = classes.IsThing(index) && key.second == 0;
        frame.segments.emplace(it->second, segment);
      }
    }
    frame.segment_ids.data()[i] = it->second;
  }
  return frame;
}

PanopticFrame DecodeSegments(const fs::path& path, const ClassResolver& classes) {
  const fs::path json_path = fs::path(path).replace_extension(".json");
  const nlohmann::json document = ReadJson(json_path);
  const bool is_list = document.is_array();
  const auto infos = document.is_object() ? document.find("segments_info") : document.end();
  if (!is_list && (infos == document.end() || !infos->is_array())) {
    ThrowInputError("{}: 'segments_info' is missing or not a list", json_path.string());
  }
  constexpr auto kMaxId = static_cast<uint32_t>(std::numeric_limits<int32_t>::max());
  constexpr SegmentRules kRules = {0, kMaxId, true};
  const SegmentTable table =
      ParseSegments(is_list ? document : *infos, classes, kRules, json_path.string());
  const IdImage image = ReadIdImage(path);
  PanopticFrame frame{path.string(), {}, table.segments, {}};
  frame.segment_ids = SegmentsFromIds(image.ids, [&](int32_t id) {
    const auto segment = static_cast<uint32_t>(id);
    if (id >= 0 && table.segments.contains(segment)) return segment;
    if (table.void_segments.contains(segment) || MayBeVoid(image, id)) return kNoSegment;
    ThrowInputError("{}: segment {} is not in {}{}", path.string(), id, json_path.string(),
                    kInterpolationHint);
  });
  return frame;
}

}  // namespace s3lam
