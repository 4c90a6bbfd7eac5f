#pragma once

#include <array>
#include <cstdint>
#include <map>

#include "s3lam/base/id.h"

namespace s3lam {

/// A 256-bit binary descriptor (ORB).
using BinaryDescriptor = std::array<uint8_t, 32>;

/// One representative descriptor per scene point.
using PointDescriptors = std::map<PointId, BinaryDescriptor>;

}  // namespace s3lam
