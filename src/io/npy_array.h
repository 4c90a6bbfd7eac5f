#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace s3lam {

/// The content of a .npy file, not interpreted: C order, little endian.
struct NpyArray {
  std::string type;  // "f4", "u1", ...: kind and bytes per item.
  std::vector<int64_t> shape;
  std::string bytes;  // The whole file; the items begin at `offset`.
  size_t offset = 0;

  [[nodiscard]] const char* data() const { return bytes.data() + offset; }
};

/// Parses a .npy file of version 1, 2 or 3. Throws InputError naming `source` for what is not one,
/// is cut short, too long for its shape, of Fortran order or big endian.
NpyArray ParseNpy(std::string bytes, const std::string& source);

/// The one array in a .npz archive (or, among several, "probabilities" or "arr_0"), as the bytes of
/// its .npy file. Throws InputError naming `source` for what is no such archive or damaged.
std::string ExtractNpz(const std::string& archive, const std::string& source);

}  // namespace s3lam
