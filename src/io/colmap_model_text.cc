#include <fmt/format.h>

#include <cmath>
#include <iterator>
#include <optional>
#include <ostream>

#include "colmap_common.h"
#include "line_parser.h"
#include "s3lam/io/colmap_model.h"

namespace s3lam {
namespace {

using internal::LineParser;
using internal::LineReader;
using internal::PromisedCount;

/// Empty for a camera that is left out.
std::optional<Camera> ParseCamera(LineParser parser, const std::string& source,
                                  const Reconstruction& known) {
  Camera camera;
  camera.id = CameraId(parser.Integer<uint32_t>("camera id"));
  const std::string_view name = parser.Word("camera model");
  const auto model = CameraModelFromName(name);
  if (!model && internal::CanSkipCamera(known, camera.id, name, source)) return std::nullopt;
  if (!model) {
    parser.Fail("unsupported camera model '{}' (supported: {})", name, SupportedCameraModels());
  }
  camera.model = *model;
  camera.width = parser.Integer<int>("width");
  camera.height = parser.Integer<int>("height");
  camera.params.resize(static_cast<size_t>(CameraModelNumParams(camera.model)));
  for (double& param : camera.params) param = parser.Real("camera parameter");
  parser.ExpectEnd();
  return camera;
}

Image ParseImageHeader(LineParser parser, const std::string& source) {
  Image image;
  image.id = ImageId(parser.Integer<uint32_t>("image id"));
  Eigen::Quaterniond rotation;
  rotation.w() = parser.Real("qw");
  rotation.x() = parser.Real("qx");
  rotation.y() = parser.Real("qy");
  rotation.z() = parser.Real("qz");
  image.cam_from_world.rotation = internal::TidyQuaternion(rotation);
  for (double& coordinate : image.cam_from_world.translation) {
    coordinate = parser.Real("translation");
  }
  image.camera_id = CameraId(parser.Integer<uint32_t>("camera id"));
  image.name = parser.Rest();
  internal::CheckImageName(image.name, image.id, source);
  return image;
}

std::vector<Point2D> ParsePoints2D(LineParser parser) {
  std::vector<Point2D> points2D;
  while (!parser.AtEnd()) {
    Point2D& point2D = points2D.emplace_back();
    point2D.xy.x() = parser.Real("keypoint x");
    point2D.xy.y() = parser.Real("keypoint y");
    const std::string_view id = parser.Word("point id");
    if (id != "-1") {
      const char* end = id.data() + id.size();
      uint64_t value = 0;
      const auto [stop, error] = std::from_chars(id.data(), end, value);
      if (error != std::errc() || stop != end) parser.Fail("point id is not an integer: '{}'", id);
      point2D.point_id = PointId(value);
    }
  }
  return points2D;
}

ScenePoint ParsePoint(LineParser& parser) {
  ScenePoint point;
  for (double& coordinate : point.xyz) coordinate = parser.Real("coordinate");
  for (uint8_t& channel : point.color) {
    const int value = parser.Integer<int>("colour");
    if (value < 0 || value > 255) parser.Fail("colour {} is not in 0..255", value);
    channel = static_cast<uint8_t>(value);
  }
  point.error = parser.Real("error");
  while (!parser.AtEnd()) {
    const ImageId image_id(parser.Integer<uint32_t>("image id of the track"));
    point.track.push_back({image_id, parser.Integer<uint32_t>("keypoint index of the track")});
  }
  return point;
}

/// Formats into a block of memory that goes to the stream when it is large.
class TextWriter {
 public:
  explicit TextWriter(std::ostream& stream) : stream_(stream) {}
  ~TextWriter() { Flush(); }
  TextWriter(const TextWriter&) = delete;
  TextWriter& operator=(const TextWriter&) = delete;

  template <typename... Args>
  void Add(fmt::format_string<Args...> format, Args&&... args) {
    fmt::format_to(std::back_inserter(buffer_), format, std::forward<Args>(args)...);
    if (buffer_.size() > kBufferSize) Flush();
  }

 private:
  static constexpr size_t kBufferSize = 1 << 20;

  void Flush() {
    stream_.write(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
    buffer_.clear();
  }

  std::ostream& stream_;
  fmt::memory_buffer buffer_;
};

double Mean(size_t sum, size_t count) {
  return count == 0 ? 0.0 : static_cast<double>(sum) / static_cast<double>(count);
}

}  // namespace

void ReadCamerasText(std::istream& stream, const std::string& source, Reconstruction& model) {
  LineReader reader(stream, source);
  PromisedCount promised;
  size_t count = 0;
  for (; reader.NextData(promised); ++count) {
    auto camera = ParseCamera(reader.Parser(), source, model);
    if (!camera) continue;
    const CameraId id = camera->id;
    internal::InsertUnique(model.cameras, id, std::move(*camera), "camera", source);
  }
  promised.Check(count, reader, "cameras", source);
}

void ReadImagesText(std::istream& stream, const std::string& source, Reconstruction& model) {
  LineReader reader(stream, source);
  PromisedCount promised;
  size_t count = 0;
  for (; reader.NextData(promised); ++count) {
    Image image = ParseImageHeader(reader.Parser(), source);
    // The line of keypoints stands even if there are none, so it is taken whatever it holds.
    if (!reader.NextRaw()) {
      ThrowInputError("{}: ends before the keypoint line of image {}: cut short", source,
                      image.id.value());
    }
    image.points2D = ParsePoints2D(reader.Parser());
    const ImageId id = image.id;
    internal::InsertUnique(model.images, id, std::move(image), "image", source);
  }
  promised.Check(count, reader, "images", source);
}

void ReadPointsText(std::istream& stream, const std::string& source, Reconstruction& model) {
  LineReader reader(stream, source);
  PromisedCount promised;
  size_t count = 0;
  for (; reader.NextData(promised); ++count) {
    LineParser parser = reader.Parser();
    const PointId id(parser.Integer<uint64_t>("point id"));
    internal::InsertUnique(model.points, id, ParsePoint(parser), "point", source);
  }
  promised.Check(count, reader, "points", source);
}

void WriteCamerasText(const Reconstruction& model, std::ostream& stream) {
  TextWriter writer(stream);
  writer.Add("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: {}\n",
             model.cameras.size());
  for (const auto& [id, camera] : model.cameras) {
    writer.Add("{} {} {} {}", id.value(), CameraModelName(camera.model), camera.width,
               camera.height);
    for (const double param : camera.params) writer.Add(" {}", param);
    writer.Add("\n");
  }
}

void WriteImagesText(const Reconstruction& model, std::ostream& stream) {
  TextWriter writer(stream);
  writer.Add(
      "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
      "# POINTS2D[] as (X, Y, POINT3D_ID)\n"
      "# Number of images: {}, mean observations per image: {}\n",
      model.images.size(), Mean(model.NumObservations(), model.images.size()));
  for (const auto& [id, image] : model.images) {
    const Eigen::Quaterniond& q = image.cam_from_world.rotation;
    const Eigen::Vector3d& t = image.cam_from_world.translation;
    writer.Add("{} {} {} {} {} {} {} {} {} {}\n", id.value(), q.w(), q.x(), q.y(), q.z(), t.x(),
               t.y(), t.z(), image.camera_id.value(), image.name);
    const char* separator = "";
    for (const Point2D& point2D : image.points2D) {
      writer.Add("{}{} {} ", separator, point2D.xy.x(), point2D.xy.y());
      if (point2D.point_id.valid()) {
        writer.Add("{}", point2D.point_id.value());
      } else {
        writer.Add("-1");
      }
      separator = " ";
    }
    writer.Add("\n");
  }
}

void WritePointsText(const Reconstruction& model, std::ostream& stream) {
  TextWriter writer(stream);
  writer.Add(
      "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
      "# Number of points: {}, mean track length: {}\n",
      model.points.size(), Mean(model.NumObservations(), model.points.size()));
  for (const auto& [id, point] : model.points) {
    writer.Add("{} {} {} {} {} {} {} {}", id.value(), point.xyz.x(), point.xyz.y(), point.xyz.z(),
               point.color[0], point.color[1], point.color[2], point.error);
    for (const TrackElement& element : point.track) {
      writer.Add(" {} {}", element.image_id.value(), element.point2D_index);
    }
    writer.Add("\n");
  }
}

}  // namespace s3lam
