#pragma once

#include <cstddef>
#include <functional>

namespace s3lam {

/// Number of threads to use: `requested` if positive, else the number of hardware threads.
int ResolveThreads(int requested);

/// Calls body(i) for every i in [0, count), on up to `num_threads` threads, each i exactly once and
/// in no particular order. The body writes only to what belongs to item i, so the result does not
/// depend on the number of threads. The first exception thrown is rethrown here.
void ParallelFor(size_t count, int num_threads, const std::function<void(size_t)>& body);

}  // namespace s3lam
