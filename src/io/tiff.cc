#include "tiff.h"

#include <cstdint>

namespace s3lam::internal {
namespace {

constexpr unsigned kTiffVersion = 42;
constexpr unsigned kBigTiffVersion = 43;
constexpr size_t kTypeRational = 5;

/// Bytes of the types that are whole numbers; 0 for all others. Those with a sign read as those
/// without.
size_t NumBytes(size_t type) {
  switch (type) {
    case 1:
    case 6:
      return 1;
    case 3:
    case 8:
      return 2;
    case 4:
    case 9:
      return 4;
    case 16:
    case 17:
      return 8;
    default:
      return 0;
  }
}

}  // namespace

Tiff::Tiff(std::string_view bytes) : bytes_(bytes), big_endian_(bytes.starts_with("MM")) {
  is_big_tiff_ = Number(2, 2) == kBigTiffVersion;
}

bool Tiff::IsTiff() const {
  return (bytes_.starts_with("MM") || bytes_.starts_with("II")) &&
         (is_big_tiff_ || Number(2, 2) == kTiffVersion);
}

std::optional<size_t> Tiff::FirstDirectory() const {
  return is_big_tiff_ ? Number(8, 8) : Number(4, 4);
}

std::optional<double> Tiff::Value(size_t directory, unsigned tag) const {
  // The number of entries, then of each: tag (2 bytes), type (2), number of values, values or
  // place.
  const size_t count_bytes = is_big_tiff_ ? 8 : 2;
  const size_t entry_bytes = is_big_tiff_ ? 20 : 12;
  const auto count = Number(directory, count_bytes);
  if (!count) return std::nullopt;
  size_t entry = directory + count_bytes;
  for (size_t i = 0; i < *count; ++i, entry += entry_bytes) {
    const auto found = Number(entry, 2);
    if (!found) return std::nullopt;
    if (*found == tag) return ValueAt(entry);
  }
  return std::nullopt;
}

std::optional<double> Tiff::ValueAt(size_t entry) const {
  const size_t word = is_big_tiff_ ? 8 : 4;
  const auto type = Number(entry + 2, 2);
  const auto count = Number(entry + 4, word);
  const auto elsewhere = Number(entry + 4 + word, word);
  if (!type || !count || !elsewhere) return std::nullopt;
  if (type == kTypeRational) {
    const auto numerator = Number(*elsewhere, 4);
    const auto denominator = Number(*elsewhere + 4, 4);
    if (!numerator || !denominator || *denominator == 0) return std::nullopt;
    return static_cast<double>(*numerator) / static_cast<double>(*denominator);
  }
  const size_t num_bytes = NumBytes(*type);
  if (num_bytes == 0 || *count == 0) return std::nullopt;
  const bool fits = *count <= word / num_bytes;
  const auto value = Number(fits ? entry + 4 + word : *elsewhere, num_bytes);
  if (!value) return std::nullopt;
  return static_cast<double>(*value);
}

std::optional<size_t> Tiff::Number(size_t place, size_t num_bytes) const {
  if (place > bytes_.size() || bytes_.size() - place < num_bytes) return std::nullopt;
  size_t number = 0;
  for (size_t i = 0; i < num_bytes; ++i) {
    const size_t next = big_endian_ ? place + i : place + num_bytes - 1 - i;
    number = number << 8 | static_cast<uint8_t>(bytes_[next]);
  }
  return number;
}

}  // namespace s3lam::internal
