#include "s3lam/io/descriptors.h"

#include <cerrno>
#include <cstring>
#include <fstream>

#include "binary_stream.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

constexpr std::string_view kMagic = "S3DESC";
constexpr std::string_view kVersion = "01";

}  // namespace

PointDescriptors ReadDescriptors(std::istream& stream, const std::string& source) {
  internal::BinaryReader reader(stream, source);
  internal::ExpectHeader(reader, kMagic, kVersion, "point descriptors", source);
  const uint64_t count = reader.Count(sizeof(uint64_t) + sizeof(BinaryDescriptor), "descriptors");
  PointDescriptors descriptors;
  for (uint64_t i = 0; i < count; ++i) {
    const PointId id(reader.Value<uint64_t>());
    if (!id.valid() || (!descriptors.empty() && id <= descriptors.rbegin()->first)) {
      ThrowInputError("{}: point id {} is out of order", source, id.value());
    }
    descriptors.emplace_hint(descriptors.end(), id, reader.Value<BinaryDescriptor>());
  }
  reader.ExpectEnd();
  return descriptors;
}

PointDescriptors ReadDescriptors(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream) ThrowInputError("{}: cannot open: {}", path.string(), std::strerror(errno));
  return ReadDescriptors(stream, path.string());
}

void WriteDescriptors(const PointDescriptors& descriptors, std::ostream& stream) {
  internal::BinaryWriter writer(stream);
  internal::WriteHeader(writer, kMagic, kVersion);
  writer.Value<uint64_t>(descriptors.size());
  for (const auto& [id, descriptor] : descriptors) {
    writer.Value(id.value());
    writer.Value(descriptor);
  }
}

void WriteDescriptors(const PointDescriptors& descriptors, const std::filesystem::path& path) {
  WriteFile(path, [&](std::ostream& stream) { WriteDescriptors(descriptors, stream); });
}

}  // namespace s3lam
