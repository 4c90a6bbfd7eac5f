#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace s3lam {

/// Seeded random numbers, the same on every platform and standard library (the engine and the
/// distributions are defined here: SplitMix64, multiply-shift, Box-Muller).
class Rng {
 public:
  explicit Rng(uint64_t seed) : state_(seed) {}

  /// 64 random bits.
  uint64_t Bits();
  /// Integer in [0, n), n > 0.
  uint64_t Below(uint64_t n);
  /// Real number in [low, high).
  double Uniform(double low = 0.0, double high = 1.0);
  /// Normal deviate.
  double Gaussian(double mean = 0.0, double sigma = 1.0);
  /// `count` different indices in [0, n), in random order; count <= n.
  std::vector<size_t> Sample(size_t n, size_t count);
  /// A generator whose stream is independent of this one's, named by `stream`; does not advance
  /// this.
  [[nodiscard]] Rng Fork(uint64_t stream) const;

 private:
  uint64_t state_;
};

}  // namespace s3lam
