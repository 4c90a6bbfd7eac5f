#pragma once

#include <numeric>
#include <vector>

#include "s3lam/base/rng.h"

namespace s3lam::internal {

/// The indices below n in the order that a seed gives them; as they are for seed 0. Estimators with
/// a seed of their own that cannot be set draw other samples from data in another order.
inline std::vector<size_t> DataOrder(size_t n, uint64_t seed) {
  if (seed != 0) return Rng(seed).Sample(n, n);
  std::vector<size_t> order(n);
  std::iota(order.begin(), order.end(), size_t{0});
  return order;
}

}  // namespace s3lam::internal
