#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <map>

#include "s3lam/base/id.h"

namespace s3lam {

/// A 256-bit binary descriptor (ORB).
using BinaryDescriptor = std::array<uint8_t, 32>;

/// Number of differing bits.
inline int HammingDistance(const BinaryDescriptor& a, const BinaryDescriptor& b) {
  int distance = 0;
  for (size_t i = 0; i < a.size(); i += sizeof(uint64_t)) {
    uint64_t x = 0;
    uint64_t y = 0;
    std::memcpy(&x, a.data() + i, sizeof(x));
    std::memcpy(&y, b.data() + i, sizeof(y));
    distance += std::popcount(x ^ y);
  }
  return distance;
}

/// One representative descriptor per scene point.
using PointDescriptors = std::map<PointId, BinaryDescriptor>;

}  // namespace s3lam
