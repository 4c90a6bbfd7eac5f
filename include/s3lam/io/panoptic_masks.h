#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "s3lam/io/label_map.h"
#include "s3lam/scene/panoptic_frame.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

enum class MaskFormat {
  kAuto,
  kCoco,
  kKittiStep,
  kCityscapes,
  kScanNet,
  kLabels,
  kLabelDivisor,
  kSegments,
  kProbabilities
};

/// "auto", "coco", "kitti-step", "cityscapes", "scannet", "labels", "label-divisor", "segments",
/// "probabilities".
std::optional<MaskFormat> MaskFormatFromName(std::string_view name);
std::string_view MaskFormatName(MaskFormat format);

/// A folder of masks, opened but not decoded.
///   coco           RGB PNGs, id = R + 256 G + 65536 B, 0 is void, and one JSON whose annotations
///                  say file_name and segments_info [{id, category_id, iscrowd?, score?,
///                  distribution?}] of each
///   kitti-step     RGB PNGs: R = label, 255 is void, instance = 256 G + B
///   cityscapes     16-bit PNGs: below 1000 a label alone, else 1000 * label + instance
///   label-divisor  16-bit PNGs or integer .npy: divisor * label + instance, -1 is void
///                  (detectron2 without segments_info)
///   scannet        label-filt/ and instance-filt/ with the same names; label 0 is void
///   segments       id map (PNG of any kind, or integer .npy) and a JSON of the same name with
///                  segments_info as above, or label_id and was_fused (detectron2, Mask2Former,
///                  Hugging Face); 0 and -1 are void unless listed. An isthing must agree with the
///                  class table; where stuff is numbered apart (detectron2's Panoptic FPN) it
///                  chooses between the two tables that the label map has then
///   labels         PNG or integer .npy with one label per pixel; 0 and the largest value of the
///                  type are void unless known. Each connected piece of a thing is a segment
///   probabilities  .npy or .npz, channels x rows x columns, float32, float16 or uint8
/// A label is a class id of the table, or what the label map translates to one. A thing without
/// instance is a crowd. Segment ids are the values in the file where it has such.
class PanopticMasks {
 public:
  /// Lists the masks under `directory`, sub-folders included, and reads the JSON: `json_path`, or
  /// if empty <directory>.json beside the folder or the only *.json in it. kAuto goes by the names
  /// of the files and, between kitti-step and labels, by whether the first PNG has colours. Throws
  /// InputError naming what is missing or malformed; defects of a single mask are thrown when it is
  /// read.
  PanopticMasks(const std::filesystem::path& directory, MaskFormat format,
                const std::filesystem::path& json_path, const ClassTable& class_table,
                const LabelMap& label_map = {}, int label_divisor = 1000);
  ~PanopticMasks();
  PanopticMasks(PanopticMasks&&) noexcept;
  PanopticMasks& operator=(PanopticMasks&&) noexcept;

  [[nodiscard]] MaskFormat format() const;
  /// Of the one JSON for all masks; empty in formats without one.
  [[nodiscard]] const std::filesystem::path& json_path() const;
  /// Paths of the masks relative to the folder, sorted.
  [[nodiscard]] const std::vector<std::string>& names() const;

  /// Decodes one mask; may be called from several threads at once. Throws InputError naming the
  /// file and the reason: cut short, not a mask of this format, a segment that the JSON does not
  /// list or lists twice, a class that the table does not have, a score outside [0, 1], a
  /// distribution that does not sum to one.
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
///   3. the last folder and the file  images/cam0/000012.jpg cam0/000012.png
///   4. the file name alone           cam0/000012.jpg        masks/000012.png
/// 3 and 4 with extensions as in 2. A mask that a stricter rule gave to an image is out of the
/// running, and so is, for 4, one that lies in a folder of the name of some image's folder: it
/// belongs to an image of that folder. Where 1 or 2 found masks in folders, 3 and 4 are not for
/// those in other folders, which are of images that are not asked for. What 3 and 4 find beside 1
/// and 2 is warned of. Cityscapes' endings (_leftImg8bit, _gtFine_instanceIds, ...) do not count as
/// part of a name, nor does ScanNet's folder label-filt. Throws InputError if a rule fits several
/// masks, or gives one mask to several images.
std::vector<std::optional<size_t>> MatchMasksToImages(const std::vector<std::string>& image_names,
                                                      const std::vector<std::string>& mask_names);

}  // namespace s3lam
