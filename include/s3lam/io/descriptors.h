#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>

#include "s3lam/scene/descriptor.h"

namespace s3lam {

/// descriptors.bin, little endian: "S3DESC01", uint64 count, count x (uint64 point id, 32 bytes).
/// Throws InputError naming the source on a wrong magic, a cut file or a count that does not fit.
PointDescriptors ReadDescriptors(std::istream& stream, const std::string& source);
PointDescriptors ReadDescriptors(const std::filesystem::path& path);
void WriteDescriptors(const PointDescriptors& descriptors, std::ostream& stream);
void WriteDescriptors(const PointDescriptors& descriptors, const std::filesystem::path& path);

}  // namespace s3lam
