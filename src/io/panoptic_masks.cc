#include "s3lam/io/panoptic_masks.h"

#include <algorithm>
#include <array>
#include <span>
#include <utility>

#include "coco_panoptic.h"
#include "id_image.h"
#include "mask_decoders.h"
#include "s3lam/base/error.h"

namespace s3lam {
namespace fs = std::filesystem;
namespace {

constexpr std::array<std::string_view, 9> kFormatNames = {
    "auto",   "coco",          "kitti-step", "cityscapes",   "scannet",
    "labels", "label-divisor", "segments",   "probabilities"};
constexpr std::string_view kInstanceIds = "_instanceIds.png";

struct FolderPair {
  std::string_view labels;
  std::string_view instances;
};
constexpr std::array<FolderPair, 2> kScanNetFolders = {
    {{"label-filt", "instance-filt"}, {"label", "instance"}}};

/// All files below the folder, relative to it, sorted.
std::vector<std::string> ListFiles(const fs::path& directory) {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(directory)) {
    if (entry.is_regular_file()) {
      names.push_back(entry.path().lexically_relative(directory).generic_string());
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

std::vector<std::string> WithEnding(const std::vector<std::string>& names,
                                    std::span<const std::string_view> endings) {
  std::vector<std::string> found;
  std::copy_if(names.begin(), names.end(), std::back_inserter(found), [&](const std::string& name) {
    return std::any_of(endings.begin(), endings.end(),
                       [&](std::string_view ending) { return name.ends_with(ending); });
  });
  return found;
}

std::vector<std::string> WithEnding(const std::vector<std::string>& names,
                                    std::string_view ending) {
  return WithEnding(names, std::array<std::string_view, 1>{ending});
}

/// The JSON that goes with the folder; an empty path if there is none.
fs::path FindJson(const fs::path& directory, const std::vector<std::string>& files) {
  fs::path beside = directory.has_filename() ? directory : directory.parent_path();
  beside += ".json";
  if (fs::is_regular_file(beside)) return beside;
  const std::vector<std::string> inside = WithEnding(files, ".json");
  if (inside.size() > 1) {
    ThrowInputError("{}: both {} and {} might describe the masks; give --mask-json",
                    directory.string(), inside[0], inside[1]);
  }
  return inside.empty() ? fs::path() : directory / inside.front();
}

/// The sub-folders of a ScanNet pair; empty if there are none.
std::optional<FolderPair> FindScanNetFolders(const fs::path& directory) {
  for (const FolderPair& pair : kScanNetFolders) {
    if (fs::is_directory(directory / pair.labels) && fs::is_directory(directory / pair.instances)) {
      return pair;
    }
  }
  return std::nullopt;
}

/// What a folder holds, by the names of its files.
MaskFormat DetectFormat(const fs::path& directory, const std::vector<std::string>& files,
                        const fs::path& json_path) {
  if (!json_path.empty()) return MaskFormat::kCoco;
  if (FindScanNetFolders(directory)) return MaskFormat::kScanNet;
  if (!WithEnding(files, kInstanceIds).empty()) return MaskFormat::kCityscapes;
  const std::vector<std::string> images = WithEnding(files, ".png");
  if (images.empty()) {
    const std::vector<std::string> arrays = WithEnding(files, ".npy");
    const bool have_json = !arrays.empty() && WithEnding(files, ".json").size() >= arrays.size();
    return have_json ? MaskFormat::kSegments : MaskFormat::kProbabilities;
  }
  const fs::path own_json = fs::path(images.front()).replace_extension(".json");
  if (std::binary_search(files.begin(), files.end(), own_json.generic_string())) {
    return MaskFormat::kSegments;
  }
  if (!FindJson(directory, files).empty()) return MaskFormat::kCoco;
  return HasColourPixels(directory / images.front()) ? MaskFormat::kKittiStep : MaskFormat::kLabels;
}

/// The masks of a format among the files; those of a pair by the name of the labels.
std::vector<std::string> SelectMasks(MaskFormat format, const fs::path& directory,
                                     const std::vector<std::string>& files) {
  constexpr std::array<std::string_view, 2> kIds = {".png", ".npy"};
  constexpr std::array<std::string_view, 2> kVolumes = {".npy", ".npz"};
  switch (format) {
    case MaskFormat::kCityscapes: {
      const std::vector<std::string> named = WithEnding(files, kInstanceIds);
      return named.empty() ? WithEnding(files, ".png") : named;
    }
    case MaskFormat::kScanNet: {
      const auto pair = FindScanNetFolders(directory);
      if (!pair) {
        ThrowInputError("{}: no sub-folders label-filt and instance-filt", directory.string());
      }
      std::vector<std::string> names = WithEnding(files, ".png");
      std::erase_if(names, [&](const std::string& name) {
        return !name.starts_with(std::string(pair->labels) + "/");
      });
      return names;
    }
    case MaskFormat::kLabels:
    case MaskFormat::kLabelDivisor:
    case MaskFormat::kSegments:
      return WithEnding(files, kIds);
    case MaskFormat::kProbabilities:
      return WithEnding(files, kVolumes);
    default:
      return WithEnding(files, ".png");
  }
}

/// "label-filt/a/0.png" -> "instance-filt/a/0.png".
fs::path InstancesOf(const fs::path& directory, const std::string& label_name) {
  const auto pair = FindScanNetFolders(directory);
  const std::string rest = label_name.substr(label_name.find('/') + 1);
  return directory / (pair ? pair->instances : std::string_view()) / rest;
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
  ClassResolver classes;
  int label_divisor = 1000;
  std::vector<std::string> names;
  std::map<std::string, CocoAnnotation> annotations;
};

PanopticMasks::PanopticMasks(const fs::path& directory, MaskFormat format,
                             const fs::path& json_path, const ClassTable& class_table,
                             const LabelMap& label_map, int label_divisor)
    : impl_(
          new Impl{directory, json_path, format, {class_table, label_map}, label_divisor, {}, {}}) {
  if (!fs::is_directory(directory)) {
    ThrowInputError("{}: no such folder of masks", directory.string());
  }
  if (label_divisor < 1) ThrowInputError("{}: the label divisor is below 1", directory.string());
  const std::vector<std::string> files = ListFiles(directory);
  if (format == MaskFormat::kAuto) impl_->format = DetectFormat(directory, files, json_path);
  if (label_map.NumbersStuffApart() && impl_->format != MaskFormat::kSegments) {
    ThrowInputError(
        "{}: tables of things and of stuff are for masks whose segments say which they are "
        "(format segments, isthing), not for format {}",
        label_map.source, MaskFormatName(impl_->format));
  }
  impl_->names = SelectMasks(impl_->format, directory, files);
  if (impl_->names.empty()) {
    ThrowInputError("{}: no masks{} in it", directory.string(),
                    format == MaskFormat::kAuto
                        ? std::string()
                        : fmt::format(" of format {}", MaskFormatName(format)));
  }
  if (impl_->format != MaskFormat::kCoco) return;
  if (json_path.empty()) impl_->json_path = FindJson(directory, files);
  if (impl_->json_path.empty()) {
    ThrowInputError("{}: COCO panoptic masks need their JSON; give --mask-json",
                    directory.string());
  }
  impl_->annotations = ReadCocoAnnotations(impl_->json_path, impl_->classes);
}

PanopticMasks::~PanopticMasks() = default;
PanopticMasks::PanopticMasks(PanopticMasks&&) noexcept = default;
PanopticMasks& PanopticMasks::operator=(PanopticMasks&&) noexcept = default;

const fs::path& PanopticMasks::json_path() const { return impl_->json_path; }
MaskFormat PanopticMasks::format() const { return impl_->format; }
const std::vector<std::string>& PanopticMasks::names() const { return impl_->names; }

PanopticFrame PanopticMasks::Read(size_t index) const {
  const std::string& name = impl_->names.at(index);
  const fs::path path = impl_->directory / name;
  const ClassResolver& classes = impl_->classes;
  switch (impl_->format) {
    case MaskFormat::kKittiStep:
      return DecodeKittiStep(path, classes);
    case MaskFormat::kCityscapes:
      return DecodeDivided(path, classes, 1000, true);
    case MaskFormat::kLabelDivisor:
      return DecodeDivided(path, classes, impl_->label_divisor, false);
    case MaskFormat::kScanNet:
      return DecodeScanNet(path, InstancesOf(impl_->directory, name), classes);
    case MaskFormat::kSegments:
      return DecodeSegments(path, classes);
    case MaskFormat::kLabels:
      return DecodeLabels(path, classes);
    case MaskFormat::kProbabilities:
      return DecodeProbabilities(path, classes);
    default:
      break;
  }
  const auto annotation = impl_->annotations.find(name);
  if (annotation == impl_->annotations.end()) {
    ThrowInputError("{}: has no annotation in {}", path.string(), impl_->json_path.string());
  }
  return DecodeCoco(path, annotation->second);
}

}  // namespace s3lam
