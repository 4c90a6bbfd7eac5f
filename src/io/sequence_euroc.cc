#include <algorithm>
#include <cmath>
#include <cstdint>
#include <sstream>

#include "line_parser.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"
#include "sequence_formats.h"

namespace s3lam::internal {
namespace fs = std::filesystem;
namespace {

constexpr double kMaxImageSide = 1e6;  // px

/// The folder with data.csv: `path` itself, or cam0 below it.
fs::path FindCameraFolder(const fs::path& path) {
  for (const char* below : {"mav0/cam0", "cam0", "."}) {
    if (fs::is_regular_file(path / below / "data.csv")) return (path / below).lexically_normal();
  }
  return {};
}

/// The few keys of a sensor.yaml that describe a camera: `key: value` and `key: [a, b, ...]`, the
/// list possibly over several lines.
class SensorYaml {
 public:
  explicit SensorYaml(const fs::path& path) : source_(path.string()) {
    std::istringstream stream(ReadFile(path));
    for (std::string line; std::getline(stream, line);) {
      text_ += line.substr(0, line.find('#')) + "\n";
    }
  }

  [[nodiscard]] std::string Word(const std::string& key) const {
    std::istringstream value(text_.substr(Find(key), text_.find('\n', Find(key)) - Find(key)));
    std::string word;
    value >> word;
    std::erase_if(word, [](char c) { return c == '"' || c == '\''; });
    return word;
  }

  [[nodiscard]] std::vector<double> List(const std::string& key, size_t size) const {
    const size_t open = text_.find_first_not_of(" \t", Find(key));
    const size_t close = text_.find(']', open);
    if (open == std::string::npos || text_[open] != '[' || close == std::string::npos) {
      ThrowInputError("{}: {} is not a list", source_, key);
    }
    std::string items = text_.substr(open + 1, close - open - 1);
    for (char& c : items) {
      if (c == ',' || c == '\n') c = ' ';
    }
    LineParser parser(items, source_, 1 + std::count(text_.begin(), text_.begin() + open, '\n'));
    std::vector<double> values;
    while (!parser.AtEnd()) values.push_back(parser.Real(key));
    if (values.size() != size) {
      ThrowInputError("{}: {} has {} numbers, expected {}", source_, key, values.size(), size);
    }
    return values;
  }

  [[nodiscard]] const std::string& source() const { return source_; }

 private:
  /// Where the value of a top-level key begins.
  [[nodiscard]] size_t Find(const std::string& key) const {
    const size_t place = ("\n" + text_).find("\n" + key + ":");
    if (place == std::string::npos) ThrowInputError("{}: {} is missing", source_, key);
    return place + key.size() + 1;
  }

  std::string source_;
  std::string text_;
};

/// EuRoC's first pixel centre is (0, 0).
Camera ReadSensorYaml(const fs::path& path) {
  const SensorYaml yaml(path);
  const std::vector<double> size = yaml.List("resolution", 2);
  for (const double side : size) {
    if (side < 1.0 || side > kMaxImageSide || side != std::floor(side)) {
      ThrowInputError("{}: resolution {} x {} is not a size in px", yaml.source(), size[0],
                      size[1]);
    }
  }
  const std::vector<double> k = yaml.List("intrinsics", 4);
  Camera camera;
  camera.id = CameraId(1);
  camera.width = static_cast<int>(size[0]);
  camera.height = static_cast<int>(size[1]);
  camera.params = {k[0], k[1], k[2] + 0.5, k[3] + 0.5};
  const std::string distortion = yaml.Word("distortion_model");
  if (distortion == "radial-tangential" || distortion == "radtan") {
    camera.model = CameraModel::kOpenCv;
  } else if (distortion == "equidistant") {
    camera.model = CameraModel::kOpenCvFisheye;
  } else if (distortion == "none") {
    camera.model = CameraModel::kPinhole;
  } else {
    ThrowInputError("{}: distortion_model '{}' is not supported", yaml.source(), distortion);
  }
  if (camera.model != CameraModel::kPinhole) {
    const std::vector<double> d = yaml.List("distortion_coefficients", 4);
    camera.params.insert(camera.params.end(), d.begin(), d.end());
  }
  camera.Check(yaml.source());
  return camera;
}

}  // namespace

bool IsEurocSequence(const fs::path& path) { return !FindCameraFolder(path).empty(); }

ImageSequence OpenEuroc(const fs::path& path, OwnCamera camera) {
  const fs::path folder = FindCameraFolder(path);
  if (folder.empty()) ThrowInputError("{}: no mav0/cam0/data.csv (EuRoC)", path.string());
  ImageSequence sequence;
  sequence.format = SequenceFormat::kEuroc;
  sequence.image_root = folder / "data";
  const std::string list = (folder / "data.csv").string();
  std::istringstream stream(ReadFile(list));
  LineReader reader(stream, list);
  while (reader.NextData()) {
    std::string line = reader.line();
    const size_t comma = line.find(',');
    if (comma == std::string::npos) reader.Parser().Fail("expected 'timestamp [ns],filename'");
    line[comma] = ' ';
    LineParser parser(line, list, reader.line_number());
    const auto nanoseconds = parser.Integer<int64_t>("timestamp");
    const std::string name(parser.Rest());
    if (name.empty()) parser.Fail("filename is missing");
    sequence.frames.push_back(
        {static_cast<double>(nanoseconds) * 1e-9, name, sequence.image_root / name});
  }
  if (sequence.frames.empty()) ThrowInputError("{}: lists no images", list);
  const fs::path sensor = folder / "sensor.yaml";
  if (camera == OwnCamera::kRead && fs::exists(sensor)) sequence.camera = ReadSensorYaml(sensor);
  return sequence;
}

}  // namespace s3lam::internal
