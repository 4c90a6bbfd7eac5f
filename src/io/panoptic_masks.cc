#include "s3lam/io/panoptic_masks.h"

#include <algorithm>
#include <array>
#include <functional>
#include <opencv2/core/mat.hpp>
#include <utility>

#include "coco_panoptic.h"
#include "png_mask.h"
#include "s3lam/base/error.h"

namespace s3lam {
namespace fs = std::filesystem;
namespace {

constexpr std::array<std::string_view, 3> kFormatNames = {"auto", "coco", "kitti-step"};
constexpr uint32_t kKittiVoidClass = 255;

std::vector<std::string> ListFiles(const fs::path& directory, const std::string& extension) {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(directory)) {
    if (entry.is_regular_file() && entry.path().extension() == extension) {
      names.push_back(entry.path().lexically_relative(directory).generic_string());
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

/// The JSON that goes with the folder; an empty path if there is none.
fs::path FindJson(const fs::path& directory) {
  fs::path beside = directory.has_filename() ? directory : directory.parent_path();
  beside += ".json";
  if (fs::is_regular_file(beside)) return beside;
  const std::vector<std::string> inside = ListFiles(directory, ".json");
  if (inside.size() > 1) {
    ThrowInputError("{}: both {} and {} might describe the masks; give --mask-json",
                    directory.string(), inside[0], inside[1]);
  }
  return inside.empty() ? fs::path() : directory / inside.front();
}

cv::Mat ReadColourMask(const fs::path& path) {
  cv::Mat image = ReadPngMask(path);
  if (image.depth() != CV_8U || image.channels() < 3) {
    ThrowInputError("{}: expected an RGB mask of 8 bits, got {} channel(s) of {} bits",
                    path.string(), image.channels(), 8 * image.elemSize1());
  }
  return image;
}

/// Fills segment_ids with R + 256 G + 65536 B, passed through `segment_of_colour` once per run of
/// equal pixels.
SegmentImage SegmentsFromColours(const cv::Mat& bgr,
                                 const std::function<uint32_t(uint32_t)>& segment_of_colour) {
  SegmentImage ids(bgr.rows, bgr.cols);
  const int channels = bgr.channels();
  uint32_t last_colour = kNoSegment;
  uint32_t last_id = kNoSegment;
  for (int y = 0; y < bgr.rows; ++y) {
    const uint8_t* pixel = bgr.ptr<uint8_t>(y);
    for (int x = 0; x < bgr.cols; ++x, pixel += channels) {
      const uint32_t colour = pixel[2] | pixel[1] << 8U | pixel[0] << 16U;
      if (colour != last_colour) {
        last_colour = colour;
        last_id = segment_of_colour(colour);
      }
      ids(y, x) = last_id;
    }
  }
  return ids;
}

PanopticFrame DecodeCoco(const fs::path& path, const CocoAnnotation& annotation) {
  if (!annotation.defect.empty()) throw InputError(annotation.defect);
  PanopticFrame frame{path.string(), {}, annotation.segments};
  frame.segment_ids = SegmentsFromColours(ReadColourMask(path), [&](uint32_t colour) {
    if (colour == 0) return kNoSegment;
    if (!annotation.segments.contains(colour)) {
      ThrowInputError("{}: segment {} is not in the JSON", path.string(), colour);
    }
    return colour;
  });
  return frame;
}

PanopticFrame DecodeKittiStep(const fs::path& path, const ClassTable& class_table) {
  PanopticFrame frame{path.string(), {}, {}};
  frame.segment_ids = SegmentsFromColours(ReadColourMask(path), [&](uint32_t colour) {
    const uint32_t class_id = colour & 0xffU;
    if (class_id == kKittiVoidClass) return kNoSegment;
    const std::optional<int> index = class_table.IndexOfId(static_cast<int>(class_id));
    if (!index) {
      ThrowInputError("{}: class {} is not in the class table '{}'", path.string(), class_id,
                      class_table.name);
    }
    PanopticSegment segment;
    segment.class_index = *index;
    segment.is_crowd =
        class_table.classes[static_cast<size_t>(*index)].is_thing && colour >> 8 == 0;
    frame.segments.emplace(colour, segment);
    return colour;
  });
  return frame;
}

}  // namespace

std::optional<MaskFormat> MaskFormatFromName(std::string_view name) {
  const auto it = std::find(kFormatNames.begin(), kFormatNames.end(), name);
  if (it == kFormatNames.end()) return std::nullopt;
  return static_cast<MaskFormat>(it - kFormatNames.begin());
}

std::string_view MaskFormatName(MaskFormat format) {
  return kFormatNames[static_cast<size_t>(format)];
}

struct PanopticMasks::Impl {
  fs::path directory;
  fs::path json_path;
  MaskFormat format = MaskFormat::kAuto;
  const ClassTable class_table;
  std::vector<std::string> names;
  std::map<std::string, CocoAnnotation> annotations;
};

PanopticMasks::PanopticMasks(const fs::path& directory, MaskFormat format,
                             const fs::path& json_path, const ClassTable& class_table)
    : impl_(new Impl{directory, json_path, format, class_table, {}, {}}) {
  if (!fs::is_directory(directory)) {
    ThrowInputError("{}: no such folder of masks", directory.string());
  }
  impl_->names = ListFiles(directory, ".png");
  if (impl_->names.empty()) ThrowInputError("{}: no PNG masks in it", directory.string());
  if (json_path.empty() && format != MaskFormat::kKittiStep) impl_->json_path = FindJson(directory);
  if (format == MaskFormat::kAuto) {
    impl_->format = impl_->json_path.empty() ? MaskFormat::kKittiStep : MaskFormat::kCoco;
  }
  if (impl_->format != MaskFormat::kCoco) return;
  if (impl_->json_path.empty()) {
    ThrowInputError("{}: COCO panoptic masks need their JSON; give --mask-json",
                    directory.string());
  }
  impl_->annotations = ReadCocoAnnotations(impl_->json_path, class_table);
}

PanopticMasks::~PanopticMasks() = default;
PanopticMasks::PanopticMasks(PanopticMasks&&) noexcept = default;
PanopticMasks& PanopticMasks::operator=(PanopticMasks&&) noexcept = default;

MaskFormat PanopticMasks::format() const { return impl_->format; }
const std::vector<std::string>& PanopticMasks::names() const { return impl_->names; }

PanopticFrame PanopticMasks::Read(size_t index) const {
  const std::string& name = impl_->names.at(index);
  const fs::path path = impl_->directory / name;
  if (impl_->format == MaskFormat::kKittiStep) return DecodeKittiStep(path, impl_->class_table);
  const auto annotation = impl_->annotations.find(name);
  if (annotation == impl_->annotations.end()) {
    ThrowInputError("{}: has no annotation in {}", path.string(), impl_->json_path.string());
  }
  return DecodeCoco(path, annotation->second);
}

}  // namespace s3lam
