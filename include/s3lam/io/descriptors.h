#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <iosfwd>
#include <map>
#include <string>

#include "s3lam/base/id.h"

namespace s3lam {

/// A 256-bit binary descriptor (ORB).
using BinaryDescriptor = std::array<uint8_t, 32>;

/// One representative descriptor per scene point.
using PointDescriptors = std::map<PointId, BinaryDescriptor>;

/// descriptors.bin, little endian: "S3DESC01", uint64 count, count x (uint64 point id, 32 bytes).
/// Throws InputError naming the source on a wrong magic, a cut file or a count that does not fit.
PointDescriptors ReadDescriptors(std::istream& stream, const std::string& source);
PointDescriptors ReadDescriptors(const std::filesystem::path& path);
void WriteDescriptors(const PointDescriptors& descriptors, std::ostream& stream);
void WriteDescriptors(const PointDescriptors& descriptors, const std::filesystem::path& path);

}  // namespace s3lam
