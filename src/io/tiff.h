#pragma once

#include <cstddef>
#include <optional>
#include <string_view>

namespace s3lam::internal {

/// Reads numbers of a TIFF structure, that of an image or of EXIF data; whatever lies outside it is
/// missing. BigTIFF, whose numbers are wider, is known too.
class Tiff {
 public:
  explicit Tiff(std::string_view bytes);

  [[nodiscard]] bool IsTiff() const;
  [[nodiscard]] std::optional<size_t> FirstDirectory() const;

  /// The first value of a tag in the directory at this place.
  [[nodiscard]] std::optional<double> Value(size_t directory, unsigned tag) const;

 private:
  [[nodiscard]] std::optional<double> ValueAt(size_t entry) const;
  [[nodiscard]] std::optional<size_t> Number(size_t place, size_t num_bytes) const;

  std::string_view bytes_;
  bool big_endian_;
  bool is_big_tiff_ = false;
};

}  // namespace s3lam::internal
