#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string_view>

#include "binary_stream.h"
#include "colmap_common.h"
#include "s3lam/io/colmap_model.h"

namespace s3lam {
namespace {

using internal::BinaryReader;
using internal::BinaryWriter;

// Sizes in the files [bytes].
constexpr size_t kMinCameraSize = 4 + 4 + 8 + 8;
constexpr size_t kMinImageSize = 4 + 7 * 8 + 4 + 1 + 8;
constexpr size_t kPoint2DSize = 8 + 8 + 8;
constexpr size_t kMinPointSize = 8 + 3 * 8 + 3 + 8 + 8;
constexpr size_t kTrackElementSize = 4 + 4;
constexpr size_t kMaxNameSize = 4096;

double FiniteReal(BinaryReader& reader, const char* what, uint64_t id, const std::string& source) {
  const double value = reader.Value<double>();
  if (!std::isfinite(value)) {
    ThrowInputError("{}: {} {} has a number that is not finite", source, what, id);
  }
  return value;
}

int ImageSize(BinaryReader& reader, CameraId id, const std::string& source) {
  const uint64_t size = reader.Value<uint64_t>();
  if (size > static_cast<uint64_t>(std::numeric_limits<int>::max())) {
    ThrowInputError("{}: camera {} has an image size of {} px", source, id.value(), size);
  }
  return static_cast<int>(size);
}

/// A camera model that can be passed over.
struct OtherModel {
  int id;
  std::string_view name;
  int num_params;
};
constexpr std::array<OtherModel, 2> kOtherModels = {
    {{10, "THIN_PRISM_FISHEYE", 12}, {11, "RAD_TAN_THIN_PRISM_FISHEYE", 16}}};

/// Passes over the rest of a camera that no image is of; throws InputError if it cannot be.
void SkipCamera(BinaryReader& reader, CameraId id, int model_id, const std::string& source,
                const Reconstruction& model) {
  const auto other = std::find_if(kOtherModels.begin(), kOtherModels.end(),
                                  [&](const OtherModel& m) { return m.id == model_id; });
  if (other == kOtherModels.end() || !internal::CanSkipCamera(model, id, other->name, source)) {
    ThrowInputError("{}: camera {} has the unsupported camera model id {} (supported: {})", source,
                    id.value(), model_id, SupportedCameraModels());
  }
  ImageSize(reader, id, source);
  ImageSize(reader, id, source);
  for (int i = 0; i < other->num_params; ++i) FiniteReal(reader, "camera", id.value(), source);
}

/// Empty for a camera that is left out.
std::optional<Camera> ReadCamera(BinaryReader& reader, const std::string& source,
                                 const Reconstruction& model) {
  Camera camera;
  camera.id = CameraId(reader.Value<uint32_t>());
  const int model_id = reader.Value<int32_t>();
  const auto camera_model = CameraModelFromId(model_id);
  if (!camera_model) {
    SkipCamera(reader, camera.id, model_id, source, model);
    return std::nullopt;
  }
  camera.model = *camera_model;
  camera.width = ImageSize(reader, camera.id, source);
  camera.height = ImageSize(reader, camera.id, source);
  camera.params.resize(static_cast<size_t>(CameraModelNumParams(camera.model)));
  for (double& param : camera.params) {
    param = FiniteReal(reader, "camera", camera.id.value(), source);
  }
  return camera;
}

void ReadPoints2D(BinaryReader& reader, const std::string& source, Image& image) {
  image.points2D.resize(reader.Count(kPoint2DSize, "keypoints"));
  for (Point2D& point2D : image.points2D) {
    struct {
      double x, y;
      uint64_t point_id;
    } record;
    static_assert(sizeof(record) == kPoint2DSize);
    reader.Bytes(&record, sizeof(record));
    point2D.xy = Eigen::Vector2d(record.x, record.y);
    point2D.point_id = PointId(record.point_id);
    if (!point2D.xy.allFinite()) {
      ThrowInputError("{}: image {} has a keypoint that is not finite", source, image.id.value());
    }
  }
}

Image ReadImage(BinaryReader& reader, const std::string& source) {
  Image image;
  image.id = ImageId(reader.Value<uint32_t>());
  const auto real = [&] { return FiniteReal(reader, "image", image.id.value(), source); };
  Eigen::Quaterniond rotation;
  rotation.w() = real();
  rotation.x() = real();
  rotation.y() = real();
  rotation.z() = real();
  image.cam_from_world.rotation = internal::TidyQuaternion(rotation);
  for (double& coordinate : image.cam_from_world.translation) coordinate = real();
  image.camera_id = CameraId(reader.Value<uint32_t>());
  image.name = reader.ZeroTerminated(kMaxNameSize, "image name");
  internal::CheckImageName(image.name, image.id, source);
  ReadPoints2D(reader, source, image);
  return image;
}

ScenePoint ReadPoint(BinaryReader& reader, PointId id, const std::string& source) {
  ScenePoint point;
  for (double& coordinate : point.xyz) {
    coordinate = FiniteReal(reader, "point", id.value(), source);
  }
  point.color = reader.Value<Rgb>();
  point.error = FiniteReal(reader, "point", id.value(), source);
  point.track.resize(reader.Count(kTrackElementSize, "track elements"));
  for (TrackElement& element : point.track) {
    const auto record = reader.Value<std::array<uint32_t, 2>>();
    element = {ImageId(record[0]), record[1]};
  }
  return point;
}

}  // namespace

void ReadCamerasBinary(std::istream& stream, const std::string& source, Reconstruction& model) {
  BinaryReader reader(stream, source);
  const uint64_t count = reader.Count(kMinCameraSize, "cameras");
  for (uint64_t i = 0; i < count; ++i) {
    auto camera = ReadCamera(reader, source, model);
    if (!camera) continue;
    const CameraId id = camera->id;
    internal::InsertUnique(model.cameras, id, std::move(*camera), "camera", source);
  }
  reader.ExpectEnd();
}

void ReadImagesBinary(std::istream& stream, const std::string& source, Reconstruction& model) {
  BinaryReader reader(stream, source);
  const uint64_t count = reader.Count(kMinImageSize, "images");
  for (uint64_t i = 0; i < count; ++i) {
    Image image = ReadImage(reader, source);
    const ImageId id = image.id;
    internal::InsertUnique(model.images, id, std::move(image), "image", source);
  }
  reader.ExpectEnd();
}

void ReadPointsBinary(std::istream& stream, const std::string& source, Reconstruction& model) {
  BinaryReader reader(stream, source);
  const uint64_t count = reader.Count(kMinPointSize, "points");
  for (uint64_t i = 0; i < count; ++i) {
    const PointId id(reader.Value<uint64_t>());
    internal::InsertUnique(model.points, id, ReadPoint(reader, id, source), "point", source);
  }
  reader.ExpectEnd();
}

void WriteCamerasBinary(const Reconstruction& model, std::ostream& stream) {
  BinaryWriter writer(stream);
  writer.Value<uint64_t>(model.cameras.size());
  for (const auto& [id, camera] : model.cameras) {
    writer.Value(id.value());
    writer.Value(static_cast<int32_t>(camera.model));
    writer.Value(static_cast<uint64_t>(camera.width));
    writer.Value(static_cast<uint64_t>(camera.height));
    for (const double param : camera.params) writer.Value(param);
  }
}

void WriteImagesBinary(const Reconstruction& model, std::ostream& stream) {
  BinaryWriter writer(stream);
  writer.Value<uint64_t>(model.images.size());
  for (const auto& [id, image] : model.images) {
    writer.Value(id.value());
    const Eigen::Quaterniond& q = image.cam_from_world.rotation;
    for (const double value : {q.w(), q.x(), q.y(), q.z()}) writer.Value(value);
    for (const double value : image.cam_from_world.translation) writer.Value(value);
    writer.Value(image.camera_id.value());
    writer.Bytes(image.name.c_str(), image.name.size() + 1);
    writer.Value<uint64_t>(image.points2D.size());
    for (const Point2D& point2D : image.points2D) {
      writer.Value(point2D.xy.x());
      writer.Value(point2D.xy.y());
      writer.Value(point2D.point_id.value());
    }
  }
}

void WritePointsBinary(const Reconstruction& model, std::ostream& stream) {
  BinaryWriter writer(stream);
  writer.Value<uint64_t>(model.points.size());
  for (const auto& [id, point] : model.points) {
    writer.Value(id.value());
    for (const double value : point.xyz) writer.Value(value);
    writer.Value(point.color);
    writer.Value(point.error);
    writer.Value<uint64_t>(point.track.size());
    for (const TrackElement& element : point.track) {
      writer.Value(element.image_id.value());
      writer.Value(element.point2D_index);
    }
  }
}

}  // namespace s3lam
