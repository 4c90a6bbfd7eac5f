#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "s3lam/scene/panoptic_frame.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

enum class MaskFormat { kAuto, kCoco, kKittiStep };

/// "auto", "coco", "kitti-step".
std::optional<MaskFormat> MaskFormatFromName(std::string_view name);
std::string_view MaskFormatName(MaskFormat format);

/// A folder of panoptic masks, opened but not decoded.
///   coco        RGB PNGs, id = R + 256 G + 65536 B, 0 is void, and one JSON whose annotations say
///               file_name and segments_info [{id, category_id, iscrowd?, score?}] of each
///   kitti-step  RGB PNGs: R = class id, 255 is void, instance = 256 G + B; a thing of instance 0
///   is
///               a crowd
/// Segment ids are the values in the file.
class PanopticMasks {
 public:
  /// Lists the masks under `directory`, sub-folders included, and reads the JSON: `json_path`, or
  /// if empty <directory>.json beside the folder or the only *.json in it. kAuto takes coco if
  /// there is a JSON, else what the first PNG looks like. Throws InputError naming what is missing
  /// or malformed; defects of a single mask are thrown when it is read.
  PanopticMasks(const std::filesystem::path& directory, MaskFormat format,
                const std::filesystem::path& json_path, const ClassTable& class_table);
  ~PanopticMasks();
  PanopticMasks(PanopticMasks&&) noexcept;
  PanopticMasks& operator=(PanopticMasks&&) noexcept;

  [[nodiscard]] MaskFormat format() const;
  /// Paths of the masks relative to the folder, sorted.
  [[nodiscard]] const std::vector<std::string>& names() const;

  /// Decodes one mask; may be called from several threads at once. Throws InputError naming the
  /// file and the reason: cut short, not a mask of this format, a segment that the JSON does not
  /// list or lists twice, a class that the table does not have, a score outside [0, 1].
  [[nodiscard]] PanopticFrame Read(size_t index) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The mask that belongs to each image, by name without extension; empty for an image without one.
/// The first rule that fits anything decides, for each image:
///   1. the whole relative path       cam0/000012.jpg        cam0/000012.png
///   2. the same, one more extension  cam0/000012.color.jpg  cam0/000012.png
///      dropped from either           cam0/000012.jpg        cam0/000012.panoptic.png
///   3. the file name alone           cam0/000012.jpg        masks/000012.png
///   4. the same as in 2 of the file name
/// Throws InputError if a rule fits several masks, or gives one mask to several images.
std::vector<std::optional<size_t>> MatchMasksToImages(const std::vector<std::string>& image_names,
                                                      const std::vector<std::string>& mask_names);

}  // namespace s3lam
