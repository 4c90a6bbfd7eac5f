#include "s3lam/base/rng.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

uint64_t Mix(uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

}  // namespace

uint64_t Rng::Bits() {
  state_ += 0x9e3779b97f4a7c15ULL;
  return Mix(state_);
}

uint64_t Rng::Below(uint64_t n) {
  S3LAM_CHECK(n > 0);
  return static_cast<uint64_t>((static_cast<__uint128_t>(Bits()) * n) >> 64);
}

double Rng::Uniform(double low, double high) {
  return low + (high - low) * (static_cast<double>(Bits() >> 11) * 0x1.0p-53);
}

double Rng::Gaussian(double mean, double sigma) {
  const double u = 1.0 - Uniform();
  const double v = Uniform();
  return mean + sigma * std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * v);
}

std::vector<size_t> Rng::Sample(size_t n, size_t count) {
  S3LAM_CHECK(count <= n);
  std::vector<size_t> sample;
  sample.reserve(count);
  // Few out of many is the usual case (minimal samples): draw again on a repeat.
  if (count * 4 <= n) {
    while (sample.size() < count) {
      const size_t i = Below(n);
      if (std::find(sample.begin(), sample.end(), i) == sample.end()) sample.push_back(i);
    }
    return sample;
  }
  std::vector<size_t> all(n);
  for (size_t i = 0; i < n; ++i) all[i] = i;
  for (size_t i = 0; i < count; ++i) {
    std::swap(all[i], all[i + Below(n - i)]);
    sample.push_back(all[i]);
  }
  return sample;
}

Rng Rng::Fork(uint64_t stream) const {
  return Rng(Mix(state_ ^ Mix(stream + 0x632be59bd9b4e019ULL)));
}

}  // namespace s3lam
