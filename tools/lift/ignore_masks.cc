#include "lift/ignore_masks.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <vector>

#include "common/config_files.h"
#include "lift/mask_arguments.h"
#include "s3lam/base/error.h"
#include "s3lam/base/output_directory.h"
#include "s3lam/base/parallel.h"
#include "s3lam/io/file.h"
#include "s3lam/io/ignore_masks.h"
#include "s3lam/io/image_file.h"
#include "s3lam/io/image_sequence.h"
#include "s3lam/io/semantic_map_io.h"
#include "s3lam/semantics/pipeline.h"

namespace s3lam::tools {
namespace {

namespace fs = std::filesystem;
namespace po = boost::program_options;
using nlohmann::json;

/// Refuses what only lifting onto a model can honour.
void CheckArguments(const po::variables_map& arguments) {
  for (const char* other : {"model", "confusion", "overlays", "images"}) {
    if (arguments.count(other) > 0 && !arguments[other].defaulted()) {
      throw UsageError(fmt::format("--sequence and --{} exclude each other", other));
    }
  }
  if (arguments["ignore-margin"].as<int>() < 0) {
    throw UsageError("--ignore-margin must not be negative");
  }
}

/// Of the configuration, lookup.lenient is all that these masks depend on: whatever else was
/// changed is refused.
bool ReadLenient(const po::variables_map& arguments, const CommonArguments& common) {
  const auto options = LoadOptions<LiftOptions>(common);
  LiftOptions heeded;
  heeded.lookup.lenient = options.lookup.lenient;
  const json changes = json::diff(OptionsToJson(heeded), OptionsToJson(options));
  if (!changes.empty()) {
    std::string key = changes.front()["path"].get<std::string>().substr(1);
    std::replace(key.begin(), key.end(), '/', '.');
    throw UsageError(
        fmt::format("{} has no effect with --sequence: of the configuration, only lookup.lenient "
                    "has",
                    key));
  }
  return options.lookup.lenient || arguments["lenient"].as<bool>();
}

/// The number of the video's frame that a mask is named after, whatever its extensions: 3 for
/// "clip_000003.panoptic.png" and clip.mp4. Empty for other names.
std::optional<int> FrameOfMask(const fs::path& video, const std::string& mask_name) {
  const std::string file = fs::path(mask_name).filename().string();
  const std::string prefix = video.stem().string() + "_";
  if (!file.starts_with(prefix)) return std::nullopt;
  int index = 0;
  const char* end = file.data() + file.size();
  const auto [rest, error] = std::from_chars(file.data() + prefix.size(), end, index);
  if (error != std::errc() || index < 0 || rest == end || *rest != '.') return std::nullopt;
  const std::string name = NameOfVideoFrame(video, index);
  if (std::string(file.data(), rest) != fs::path(name).stem()) return std::nullopt;
  return index;
}

/// The frames of a video that have a mask, by their names: for those it need not be decoded.
ImageSequence ListFramesWithMask(const fs::path& video, const PanopticMasks& masks) {
  std::set<int> indices;
  for (const std::string& name : masks.names()) {
    if (const auto index = FrameOfMask(video, name)) indices.insert(*index);
  }
  ImageSequence sequence;
  sequence.format = SequenceFormat::kVideo;
  sequence.image_root = video;
  for (const int index : indices) {
    sequence.frames.push_back(
        {static_cast<double>(index), NameOfVideoFrame(video, index), {}, index});
  }
  if (sequence.frames.empty()) {
    ThrowInputError("{}: no mask is named as one of its frames, such as {}", video.string(),
                    NameOfVideoFrame(video, 0));
  }
  return sequence;
}

/// Width and height of a frame's image, nothing else. Empty for a video without camera.json, which
/// would have to be decoded.
std::optional<Camera> ImageShape(const ImageSequence& sequence, const SequenceFrame& frame) {
  if (sequence.camera) return sequence.camera;
  if (frame.path.empty()) return std::nullopt;
  const cv::Size size = ReadImageSize(frame.path);
  Camera shape;
  shape.width = size.width;
  shape.height = size.height;
  return shape;
}

/// What became of one frame.
struct FrameResult {
  enum class Mask { kNone, kBad, kUsed };
  Mask mask = Mask::kNone;
  bool is_scaled = false;  // The mask is of another resolution than the image.
  double ignored_share = 0.0;
  std::optional<Camera> shape;
};

class IgnoreMaskWriter {
 public:
  IgnoreMaskWriter(const ImageSequence& sequence, const PanopticMasks& masks,
                   const ClassTable& table, int margin_px, bool is_lenient, fs::path directory)
      : sequence_(sequence),
        masks_(masks),
        table_(table),
        margin_px_(margin_px),
        is_lenient_(is_lenient),
        directory_(std::move(directory)) {}

  [[nodiscard]] FrameResult Write(const SequenceFrame& frame, size_t mask_index) const {
    FrameResult result;
    result.shape = ImageShape(sequence_, frame);
    const std::optional<PanopticFrame> panoptic = Read(frame, mask_index, result.shape);
    result.mask = panoptic ? FrameResult::Mask::kUsed : FrameResult::Mask::kBad;
    if (!panoptic) return result;
    cv::Mat mask = MakeIgnoreMask(*panoptic, table_, margin_px_);
    if (result.shape) {
      const cv::Size size(result.shape->width, result.shape->height);
      result.is_scaled = mask.size() != size;
      cv::resize(mask, mask, size, 0.0, 0.0, cv::INTER_NEAREST);
    }
    result.ignored_share = 1.0 - cv::countNonZero(mask) / static_cast<double>(mask.total());
    WriteIgnoreMask(mask, directory_, frame.name);
    return result;
  }

 private:
  /// Empty for a mask that cannot be used, if lenient.
  [[nodiscard]] std::optional<PanopticFrame> Read(const SequenceFrame& frame, size_t mask_index,
                                                  const std::optional<Camera>& shape) const {
    try {
      PanopticFrame panoptic = masks_.Read(mask_index);
      if (shape) CheckMaskShape(panoptic, *shape, frame.name);
      return panoptic;
    } catch (const InputError&) {
      if (!is_lenient_) throw;
      return std::nullopt;
    }
  }

  const ImageSequence& sequence_;
  const PanopticMasks& masks_;
  const ClassTable& table_;
  int margin_px_;
  bool is_lenient_;
  fs::path directory_;
};

struct IgnoreReport {
  size_t num_frames = 0;
  size_t num_frames_with_mask = 0;
  size_t num_frames_with_bad_mask = 0;  // Only if lenient.
  size_t num_scaled_masks = 0;
  double ignored_share = 0.0;  // Of the pixels of the frames with a mask.
};

IgnoreReport Summarize(const std::vector<FrameResult>& frames) {
  IgnoreReport report;
  report.num_frames = frames.size();
  for (const FrameResult& frame : frames) {
    report.num_frames_with_mask += frame.mask == FrameResult::Mask::kUsed ? 1 : 0;
    report.num_frames_with_bad_mask += frame.mask == FrameResult::Mask::kBad ? 1 : 0;
    report.num_scaled_masks += frame.is_scaled ? 1 : 0;
    report.ignored_share += frame.ignored_share;
  }
  report.ignored_share /= static_cast<double>(std::max<size_t>(1, report.num_frames_with_mask));
  return report;
}

void CheckSomeMaskIsUsed(const IgnoreReport& report, const fs::path& mask_directory) {
  if (report.num_frames_with_mask > 0) return;
  if (report.num_frames_with_bad_mask == 0) {
    ThrowInputError("{}: no mask fits an image", mask_directory.string());
  }
  ThrowInputError(
      "{}: all {} masks of the sequence's images are unusable: without --lenient, the first one's "
      "reason is said",
      mask_directory.string(), report.num_frames_with_bad_mask);
}

json ToJson(const IgnoreReport& report) {
  const size_t with_any = report.num_frames_with_mask + report.num_frames_with_bad_mask;
  return {{"frames", report.num_frames},
          {"frames_with_mask", report.num_frames_with_mask},
          {"frames_without_mask", report.num_frames - with_any},
          {"frames_with_bad_mask", report.num_frames_with_bad_mask},
          {"scaled_masks", report.num_scaled_masks},
          {"ignored_share", report.ignored_share}};
}

std::string ToText(const IgnoreReport& report) {
  std::string text = fmt::format("{} of {} frames", report.num_frames_with_mask, report.num_frames);
  if (report.num_frames_with_bad_mask > 0) {
    text += fmt::format(" ({} unusable)", report.num_frames_with_bad_mask);
  }
  if (report.num_scaled_masks > 0) text += fmt::format(" ({} scaled)", report.num_scaled_masks);
  return text + fmt::format(", {:.1f} % of their pixels ignored\n", 100.0 * report.ignored_share);
}

/// What is used of the images: their names, and the sizes of those that have a mask.
std::string DescribeFrames(const ImageSequence& sequence, const std::vector<FrameResult>& results) {
  std::string text;
  for (size_t i = 0; i < results.size(); ++i) {
    text += sequence.frames[i].name;
    const std::optional<Camera>& shape = results[i].shape;
    if (shape) text += fmt::format(" {} {}", shape->width, shape->height);
    text += "\n";
  }
  return text;
}

std::vector<std::string> NamesOf(const std::vector<SequenceFrame>& frames) {
  std::vector<std::string> names;
  for (const SequenceFrame& frame : frames) names.push_back(frame.name);
  return names;
}

}  // namespace

void WriteIgnoreMasks(const po::variables_map& arguments, const CommonArguments& common) {
  CheckArguments(arguments);
  const bool is_lenient = ReadLenient(arguments, common);
  const fs::path mask_path = Required(arguments, "masks");
  const fs::path class_path = FindConfigFile(Required(arguments, "classes"), "classes");
  const MaskFormat format = MaskFormatArgument(arguments);
  const int margin_px = arguments["ignore-margin"].as<int>();
  OutputDirectory output(Required(arguments, "output"), common.overwrite);

  const ClassTable table = ReadClassTable(class_path);
  const PanopticMasks masks = OpenMasks(arguments, mask_path, format, table);
  const ImageSequence sequence =
      OpenSequence(Required(arguments, "sequence"), SequenceFormat::kAuto, {},
                   [&](const fs::path& video) { return ListFramesWithMask(video, masks); });
  const auto matches = MatchMasksToImages(NamesOf(sequence.frames), masks.names());
  const IgnoreMaskWriter writer(sequence, masks, table, margin_px, is_lenient, output.path());
  std::vector<FrameResult> results(sequence.frames.size());
  ParallelFor(results.size(), common.threads, [&](size_t i) {
    if (matches[i]) results[i] = writer.Write(sequence.frames[i], *matches[i]);
  });
  const IgnoreReport summary = Summarize(results);
  CheckSomeMaskIsUsed(summary, mask_path);

  Provenance provenance("s3-lift", common, {{"lookup", {{"lenient", is_lenient}}}});
  AddMaskInputs(arguments, masks, provenance);
  provenance.AddText("frames", DescribeFrames(sequence, results));
  json report = ToJson(summary);
  report["ignore_margin_px"] = margin_px;
  provenance.AddTo(report);
  WriteJson(output.path() / "config.json", provenance.config());
  WriteJson(output.path() / "report.json", report);
  output.Commit();
  report.erase("config");
  PrintReport(common, ToText(summary), report);
}

}  // namespace s3lam::tools
