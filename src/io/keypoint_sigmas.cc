#include "s3lam/io/keypoint_sigmas.h"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>

#include "binary_stream.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

constexpr std::string_view kMagic = "S3KSIG";
constexpr std::string_view kVersion = "01";
constexpr size_t kImageSize = sizeof(uint32_t) + sizeof(uint64_t);

}  // namespace

KeypointSigmas ReadKeypointSigmas(std::istream& stream, const std::string& source) {
  internal::BinaryReader reader(stream, source);
  internal::ExpectHeader(reader, kMagic, kVersion, "keypoint sigmas", source);
  const uint64_t num_images = reader.Count(kImageSize, "images");
  KeypointSigmas sigmas;
  for (uint64_t i = 0; i < num_images; ++i) {
    const ImageId id(reader.Value<uint32_t>());
    if (!id.valid() || (!sigmas.empty() && id <= sigmas.rbegin()->first)) {
      ThrowInputError("{}: image id {} is out of order", source, id.value());
    }
    std::vector<float> of_image(reader.Count(sizeof(float), "keypoints"));
    for (float& sigma : of_image) {
      sigma = reader.Value<float>();
      if (std::isfinite(sigma) && sigma > 0.0F) continue;
      ThrowInputError("{}: a keypoint of image {} with sigma {} px", source, id.value(), sigma);
    }
    sigmas.emplace_hint(sigmas.end(), id, std::move(of_image));
  }
  reader.ExpectEnd();
  return sigmas;
}

KeypointSigmas ReadKeypointSigmas(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream) ThrowInputError("{}: cannot open: {}", path.string(), std::strerror(errno));
  return ReadKeypointSigmas(stream, path.string());
}

void WriteKeypointSigmas(const KeypointSigmas& sigmas, std::ostream& stream) {
  internal::BinaryWriter writer(stream);
  internal::WriteHeader(writer, kMagic, kVersion);
  writer.Value<uint64_t>(sigmas.size());
  for (const auto& [id, of_image] : sigmas) {
    writer.Value(id.value());
    writer.Value<uint64_t>(of_image.size());
    for (const float sigma : of_image) writer.Value(sigma);
  }
}

void WriteKeypointSigmas(const KeypointSigmas& sigmas, const std::filesystem::path& path) {
  WriteFile(path, [&](std::ostream& stream) { WriteKeypointSigmas(sigmas, stream); });
}

void CheckKeypointSigmas(const KeypointSigmas& sigmas, const Reconstruction& model,
                         const std::string& source) {
  for (const auto& [id, image] : model.images) {
    const auto it = sigmas.find(id);
    const size_t count = it == sigmas.end() ? 0 : it->second.size();
    if (count == image.points2D.size()) continue;
    ThrowInputError("{}: {} sigmas for the {} keypoints of image {}: of another model", source,
                    count, image.points2D.size(), image.name);
  }
}

}  // namespace s3lam
