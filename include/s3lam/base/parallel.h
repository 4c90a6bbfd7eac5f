#pragma once

#include <cstddef>
#include <functional>

namespace s3lam {

/// Number of threads to use: `requested` if positive, else the number of hardware threads.
int ResolveThreads(int requested);

/// Calls body(i) for every i in [0, count), on up to `num_threads` threads, each i exactly once and
/// in no particular order. The body writes only to what belongs to item i, so the result does not
/// depend on the number of threads. Of the exceptions thrown, that of the smallest i is rethrown
/// here: items are begun in ascending order, so it is the one that a single thread would meet.
void ParallelFor(size_t count, int num_threads, const std::function<void(size_t)>& body);

}  // namespace s3lam
