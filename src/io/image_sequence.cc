#include "s3lam/io/image_sequence.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <set>
#include <string_view>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/io/file.h"
#include "s3lam/io/image_file.h"
#include "sequence_formats.h"

namespace s3lam {
namespace fs = std::filesystem;
namespace {

constexpr std::array<std::pair<std::string_view, SequenceFormat>, 7> kFormatNames = {
    {{"auto", SequenceFormat::kAuto},
     {"tum", SequenceFormat::kTum},
     {"kitti", SequenceFormat::kKitti},
     {"kitti-raw", SequenceFormat::kKittiRaw},
     {"euroc", SequenceFormat::kEuroc},
     {"folder", SequenceFormat::kFolder},
     {"video", SequenceFormat::kVideo}}};

SequenceFormat DetectFormat(const fs::path& path) {
  if (fs::is_regular_file(path)) {
    if (HasImageExtension(path)) {
      ThrowInputError("{}: a single image; give the folder of the sequence", path.string());
    }
    return SequenceFormat::kVideo;
  }
  if (internal::IsTumSequence(path)) return SequenceFormat::kTum;
  if (internal::IsEurocSequence(path)) return SequenceFormat::kEuroc;
  if (internal::IsKittiSequence(path)) return SequenceFormat::kKitti;
  if (internal::IsKittiRawSequence(path)) return SequenceFormat::kKittiRaw;
  return SequenceFormat::kFolder;
}

/// The camera.json in one of these folders, the first that has it.
std::optional<CameraFile> FindCameraFile(const std::vector<fs::path>& folders) {
  for (const fs::path& folder : folders) {
    if (fs::is_regular_file(folder / "camera.json")) return ReadCameraJson(folder / "camera.json");
  }
  return std::nullopt;
}

ImageSequence OpenFormat(const fs::path& path, SequenceFormat format, const VideoLister& list_video,
                         OwnCamera camera) {
  switch (format) {
    case SequenceFormat::kTum:
      return internal::OpenTum(path);
    case SequenceFormat::kKitti:
      return internal::OpenKitti(path, camera);
    case SequenceFormat::kKittiRaw:
      return internal::OpenKittiRaw(path, camera);
    case SequenceFormat::kEuroc:
      return internal::OpenEuroc(path, camera);
    case SequenceFormat::kVideo:
      return list_video(path);
    case SequenceFormat::kAuto:
    case SequenceFormat::kFolder:
      break;
  }
  const auto file = FindCameraFile({path});
  const bool has_fps = file && file->fps;
  return internal::OpenFolder(path, has_fps ? 1.0 / *file->fps : internal::kDefaultPeriodS);
}

/// Numbers the frames and checks what they are called.
void CheckNames(const std::string& source, ImageSequence& sequence) {
  std::set<std::string_view> names;
  for (size_t i = 0; i < sequence.frames.size(); ++i) {
    SequenceFrame& frame = sequence.frames[i];
    frame.index = static_cast<int>(i);
    if (!IsNameWithin(frame.name)) {
      ThrowInputError("{}: image name leaves the folder of the images: {}", source, frame.name);
    }
    if (!names.insert(frame.name).second) {
      ThrowInputError("{}: {} is listed twice", source, frame.name);
    }
  }
}

void SelectFrames(const FrameRange& range, const std::string& source, ImageSequence& sequence) {
  const auto size = static_cast<int>(sequence.frames.size());
  const int end = range.end < 0 ? size : std::min(range.end, size);
  std::vector<SequenceFrame> selected;
  for (int64_t i = range.first; i < end; i += range.step) {
    selected.push_back(sequence.frames[static_cast<size_t>(i)]);
  }
  if (selected.empty()) {
    ThrowInputError("{}: no frames in the range {}:{}:{} of {}", source, range.first, end,
                    range.step, size);
  }
  sequence.frames = std::move(selected);
}

void CheckTimes(const std::string& source, const ImageSequence& sequence) {
  for (size_t i = 1; i < sequence.frames.size(); ++i) {
    const SequenceFrame& frame = sequence.frames[i];
    if (frame.time_s > sequence.frames[i - 1].time_s) continue;
    ThrowInputError("{}: the time of {} ({} s) is not after that of the frame before it", source,
                    frame.name, frame.time_s);
  }
}

void CheckFilesExist(const ImageSequence& sequence) {
  for (const SequenceFrame& frame : sequence.frames) {
    if (!frame.path.empty() && !fs::is_regular_file(frame.path)) {
      ThrowInputError("{}: no such image", frame.path.string());
    }
  }
}

int ParseField(std::string_view field, int min, const std::string& text) {
  int value = 0;
  const char* end = field.data() + field.size();
  const auto [stop, error] = std::from_chars(field.data(), end, value);
  if (error != std::errc() || stop != end || value < min) {
    throw UsageError(fmt::format("frame range '{}': '{}' is not a whole number of at least {}",
                                 text, field, min));
  }
  return value;
}

ImageSequence OpenChecked(const fs::path& path, SequenceFormat format, const FrameRange& range,
                          const VideoLister& list_video, OwnCamera camera, MissingImages missing) {
  const std::string source = path.string();
  if (!fs::exists(path)) ThrowInputError("{}: no such file or directory", source);
  if (format == SequenceFormat::kAuto) format = DetectFormat(path);
  if (format == SequenceFormat::kVideo && !fs::is_regular_file(path)) {
    ThrowInputError("{}: not a video file", source);
  }
  if (format != SequenceFormat::kVideo && !fs::is_directory(path)) {
    ThrowInputError("{}: not a directory", source);
  }
  ImageSequence sequence = OpenFormat(path, format, list_video, camera);
  CheckNames(source, sequence);
  const fs::path& root = sequence.image_root;
  std::vector<fs::path> folders = {path, root};
  // Beside the images, but not beside the folder that was named (unless that is a video).
  if (root != path || format == SequenceFormat::kVideo) folders.push_back(root.parent_path());
  if (camera == OwnCamera::kRead) {
    if (const auto file = FindCameraFile(folders)) sequence.camera = file->camera;
  }
  SelectFrames(range, source, sequence);
  CheckTimes(source, sequence);
  if (missing == MissingImages::kRefused) CheckFilesExist(sequence);
  return sequence;
}

}  // namespace

std::optional<SequenceFormat> SequenceFormatFromName(std::string_view name) {
  for (const auto& [known, format] : kFormatNames) {
    if (known == name) return format;
  }
  return std::nullopt;
}

FrameRange ParseFrameRange(const std::string& text) {
  std::vector<std::string_view> fields;
  for (std::string_view rest = text;;) {
    const size_t colon = rest.find(':');
    fields.push_back(rest.substr(0, colon));
    if (colon == std::string_view::npos) break;
    rest.remove_prefix(colon + 1);
  }
  if (fields.size() < 2 || fields.size() > 3) {
    throw UsageError(fmt::format("frame range '{}': expected A:B or A:B:STEP", text));
  }
  FrameRange range;
  if (!fields[0].empty()) range.first = ParseField(fields[0], 0, text);
  if (!fields[1].empty()) range.end = ParseField(fields[1], 0, text);
  if (fields.size() == 3 && !fields[2].empty()) range.step = ParseField(fields[2], 1, text);
  return range;
}

std::string NameOfVideoFrame(const fs::path& video, int index) {
  return fmt::format("{}_{:06d}.png", video.stem().string(), index);
}

ImageSequence OpenSequence(const fs::path& path, SequenceFormat format, const FrameRange& range,
                           const VideoLister& list_video, OwnCamera camera, MissingImages missing) {
  S3LAM_CHECK(range.first >= 0 && range.step > 0);
  try {
    return OpenChecked(path, format, range, list_video, camera, missing);
  } catch (const fs::filesystem_error& error) {  // Folders that may not be looked into.
    ThrowInputError("{}: {}", error.path1().string(), error.code().message());
  }
}

}  // namespace s3lam
