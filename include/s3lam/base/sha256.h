#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace s3lam {

/// SHA-256 (FIPS 180-4), as the program sha256sum computes it.
class Sha256 {
 public:
  void Update(std::string_view bytes);
  /// 64 hexadecimal digits; the object is not to be used afterwards.
  [[nodiscard]] std::string Finish();

 private:
  void Block(const uint8_t* block);

  std::array<uint32_t, 8> state_ = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                    0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  std::array<uint8_t, 64> pending_{};
  size_t num_pending_ = 0;
  uint64_t num_bytes_ = 0;
};

}  // namespace s3lam
