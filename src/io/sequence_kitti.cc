#include <fmt/format.h>

#include <array>
#include <charconv>
#include <chrono>
#include <map>
#include <optional>
#include <sstream>

#include "line_parser.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"
#include "s3lam/io/image_file.h"
#include "sequence_formats.h"

namespace s3lam::internal {
namespace fs = std::filesystem;
namespace {

constexpr int kNumCameras = 4;  // 0 and 1 gray, 2 and 3 colour.

/// The first camera whose images are there.
std::optional<int> FindCamera(const fs::path& path, const char* folder_format) {
  for (int i = 0; i < kNumCameras; ++i) {
    if (fs::is_directory(path / fmt::format(fmt::runtime(folder_format), i))) return i;
  }
  return std::nullopt;
}

/// "key: value value ..." lines.
std::map<std::string, std::vector<double>, std::less<>> ReadCalibration(const fs::path& path) {
  const std::string source = path.string();
  std::istringstream stream(ReadFile(path));
  LineReader reader(stream, source);
  std::map<std::string, std::vector<double>, std::less<>> calibration;
  while (reader.NextData()) {
    LineParser parser = reader.Parser();
    std::string key(parser.Word("key"));
    if (key == "calib_time:") continue;  // A date.
    if (key.ends_with(':')) key.pop_back();
    std::vector<double>& values = calibration[key];
    while (!parser.AtEnd()) values.push_back(parser.Real(key));
  }
  return calibration;
}

/// Rectified pinhole camera from the 3x4 matrix `key`. KITTI's first pixel centre is (0, 0).
Camera CameraFromProjection(const fs::path& path, const std::string& key, cv::Size size) {
  const auto calibration = ReadCalibration(path);
  const auto entry = calibration.find(key);
  if (entry == calibration.end()) ThrowInputError("{}: {} is missing", path.string(), key);
  const std::vector<double>& p = entry->second;
  if (p.size() != 12) {
    ThrowInputError("{}: {} has {} numbers, expected 12", path.string(), key, p.size());
  }
  Camera camera{CameraId(1), CameraModel::kPinhole, size.width, size.height, {}};
  camera.params = {p[0], p[5], p[2] + 0.5, p[6] + 0.5};
  camera.Check(path.string());
  return camera;
}

/// Frame times by image: in order if there are as many, else by the number in the image's name, as
/// when part of a sequence was copied.
void AssignTimes(const std::vector<double>& times, const std::string& source,
                 ImageSequence& sequence) {
  const bool in_order = times.size() == sequence.frames.size();
  for (size_t i = 0; i < sequence.frames.size(); ++i) {
    SequenceFrame& frame = sequence.frames[i];
    size_t line = i;
    if (!in_order) {
      const std::string stem = frame.path.stem().string();
      const char* end = stem.data() + stem.size();
      const auto [stop, error] = std::from_chars(stem.data(), end, line);
      if (error != std::errc() || stop != end || line >= times.size()) {
        ThrowInputError("{}: {} times do not fit {} images (no time for {})", source, times.size(),
                        sequence.frames.size(), frame.name);
      }
    }
    frame.time_s = times[line];
  }
}

ImageSequence ListFrames(const fs::path& image_root, SequenceFormat format) {
  ImageSequence sequence;
  sequence.format = format;
  sequence.image_root = image_root;
  for (const std::string& name : ListImages(image_root, /*recursive=*/false)) {
    sequence.frames.push_back({0.0, name, image_root / name});
  }
  if (sequence.frames.empty()) ThrowInputError("{}: no images in this folder", image_root.string());
  return sequence;
}

/// "2011-09-26 13:02:25.964389445" in seconds since 1970.
double ParseDate(LineParser parser) {
  const std::string_view day = parser.Word("date");
  const std::string_view clock = parser.Word("time of day");
  std::string text = fmt::format("{} {}", day, clock);
  for (char& c : text) {
    if (c == '-' || c == ':') c = ' ';
  }
  std::istringstream fields(text);
  fields.imbue(std::locale::classic());
  int year = 0;
  unsigned month = 0;
  unsigned date = 0;
  int hour = 0;
  int minute = 0;
  double second = 0.0;
  fields >> year >> month >> date >> hour >> minute >> second;
  const bool is_read = !fields.fail() && fields.peek() == std::istringstream::traits_type::eof();
  const bool is_clock = hour >= 0 && hour < 24 && minute >= 0 && minute < 60 && second >= 0.0 &&
                        second < 61.0;  // Leap seconds.
  const bool is_year = year >= 1970 && year < 10000;
  const std::chrono::year_month_day ymd{std::chrono::year(year), std::chrono::month(month),
                                        std::chrono::day(date)};
  if (!is_read || !is_clock || !is_year || !ymd.ok())
    parser.Fail("not a date and time: '{} {}'", day, clock);
  const auto since_1970 = std::chrono::sys_days(ymd).time_since_epoch();
  const double days =
      static_cast<double>(std::chrono::duration_cast<std::chrono::hours>(since_1970).count());
  return (days + hour) * 3600.0 + minute * 60.0 + second;
}

std::vector<double> ReadTimes(const fs::path& path, bool dates) {
  const std::string source = path.string();
  std::istringstream stream(ReadFile(path));
  LineReader reader(stream, source);
  std::vector<double> times;
  while (reader.NextData()) {
    times.push_back(dates ? ParseDate(reader.Parser()) : reader.Parser().Real("time"));
  }
  return times;
}

}  // namespace

bool IsKittiSequence(const fs::path& path) {
  const bool has_tables = fs::exists(path / "times.txt") || fs::exists(path / "calib.txt");
  return has_tables && FindCamera(path, "image_{}").has_value();
}

bool IsKittiRawSequence(const fs::path& path) {
  return FindCamera(path, "image_{:02d}/data").has_value();
}

ImageSequence OpenKitti(const fs::path& path, OwnCamera own_camera) {
  const auto camera = FindCamera(path, "image_{}");
  if (!camera) ThrowInputError("{}: no folder image_0 (KITTI odometry)", path.string());
  ImageSequence sequence =
      ListFrames(path / fmt::format("image_{}", *camera), SequenceFormat::kKitti);
  const fs::path times = path / "times.txt";
  AssignTimes(ReadTimes(times, /*dates=*/false), times.string(), sequence);
  const fs::path calibration = path / "calib.txt";
  if (own_camera == OwnCamera::kRead && fs::exists(calibration)) {
    const cv::Size size = ReadImageSize(sequence.frames[0].path);
    sequence.camera = CameraFromProjection(calibration, fmt::format("P{}", *camera), size);
  }
  return sequence;
}

ImageSequence OpenKittiRaw(const fs::path& path, OwnCamera own_camera) {
  const auto camera = FindCamera(path, "image_{:02d}/data");
  if (!camera) ThrowInputError("{}: no folder image_00/data (KITTI raw)", path.string());
  const fs::path folder = path / fmt::format("image_{:02d}", *camera);
  ImageSequence sequence = ListFrames(folder / "data", SequenceFormat::kKittiRaw);
  const fs::path times = folder / "timestamps.txt";
  AssignTimes(ReadTimes(times, /*dates=*/true), times.string(), sequence);
  if (own_camera == OwnCamera::kIgnored) return sequence;
  // The calibration belongs to the day, whose folder holds the drives.
  const fs::path absolute = fs::absolute(path).lexically_normal();
  const fs::path drive = absolute.has_filename() ? absolute : absolute.parent_path();
  for (const fs::path& directory : {drive, drive.parent_path()}) {
    const fs::path calibration = directory / "calib_cam_to_cam.txt";
    if (!fs::exists(calibration)) continue;
    const cv::Size size = ReadImageSize(sequence.frames[0].path);
    sequence.camera =
        CameraFromProjection(calibration, fmt::format("P_rect_{:02d}", *camera), size);
    break;
  }
  return sequence;
}

}  // namespace s3lam::internal
