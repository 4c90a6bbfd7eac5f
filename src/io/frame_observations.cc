#include "s3lam/io/frame_observations.h"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>

#include "binary_stream.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

constexpr std::string_view kMagic = "S3OBSV";
constexpr std::string_view kVersion = "01";
constexpr size_t kFrameSize = sizeof(double) + sizeof(uint32_t) + sizeof(uint64_t);
constexpr size_t kObservationSize = sizeof(uint64_t) + 3 * sizeof(float);

FrameObservation ReadObservation(internal::BinaryReader& reader, const std::string& source) {
  FrameObservation observation;
  observation.point_id = PointId(reader.Value<uint64_t>());
  observation.xy.x() = reader.Value<float>();
  observation.xy.y() = reader.Value<float>();
  observation.sigma = reader.Value<float>();
  if (!observation.point_id.valid() || !observation.xy.allFinite() ||
      !std::isfinite(observation.sigma) || !(observation.sigma > 0.0F)) {
    ThrowInputError("{}: an observation of point {} at ({}, {}) px with sigma {} px", source,
                    observation.point_id.value(), observation.xy.x(), observation.xy.y(),
                    observation.sigma);
  }
  return observation;
}

}  // namespace

FrameObservations ReadFrameObservations(std::istream& stream, const std::string& source) {
  internal::BinaryReader reader(stream, source);
  internal::ExpectHeader(reader, kMagic, kVersion, "frame observations", source);
  const uint64_t num_frames = reader.Count(kFrameSize, "frames");
  FrameObservations frames;
  for (uint64_t i = 0; i < num_frames; ++i) {
    ObservedFrame frame;
    frame.time_s = reader.Value<double>();
    if (!std::isfinite(frame.time_s) || (!frames.empty() && frame.time_s <= frames.back().time_s)) {
      ThrowInputError("{}: time {} of frame {} is out of order", source, frame.time_s, i);
    }
    frame.camera_id = CameraId(reader.Value<uint32_t>());
    const uint64_t count = reader.Count(kObservationSize, "observations");
    for (uint64_t k = 0; k < count; ++k) {
      frame.observations.push_back(ReadObservation(reader, source));
    }
    frames.push_back(std::move(frame));
  }
  reader.ExpectEnd();
  return frames;
}

FrameObservations ReadFrameObservations(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream) ThrowInputError("{}: cannot open: {}", path.string(), std::strerror(errno));
  return ReadFrameObservations(stream, path.string());
}

void WriteFrameObservations(const FrameObservations& frames, std::ostream& stream) {
  internal::BinaryWriter writer(stream);
  internal::WriteHeader(writer, kMagic, kVersion);
  writer.Value<uint64_t>(frames.size());
  for (const ObservedFrame& frame : frames) {
    writer.Value(frame.time_s);
    writer.Value(frame.camera_id.value());
    writer.Value<uint64_t>(frame.observations.size());
    for (const FrameObservation& o : frame.observations) {
      writer.Value(o.point_id.value());
      writer.Value(o.xy.x());
      writer.Value(o.xy.y());
      writer.Value(o.sigma);
    }
  }
}

void WriteFrameObservations(const FrameObservations& frames, const std::filesystem::path& path) {
  WriteFile(path, [&](std::ostream& stream) { WriteFrameObservations(frames, stream); });
}

}  // namespace s3lam
