#include "s3lam/base/parallel.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace s3lam {

int ResolveThreads(int requested) {
  if (requested > 0) return requested;
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

void ParallelFor(size_t count, int num_threads, const std::function<void(size_t)>& body) {
  const size_t workers = std::min(count, static_cast<size_t>(ResolveThreads(num_threads)));
  if (workers <= 1) {
    for (size_t i = 0; i < count; ++i) body(i);
    return;
  }
  std::atomic<size_t> next{0};
  std::mutex error_mutex;
  std::exception_ptr error;
  size_t error_item = count;
  const auto work = [&] {
    for (size_t i = next++; i < count; i = next++) {
      try {
        body(i);
      } catch (...) {
        const std::lock_guard lock(error_mutex);
        if (i < error_item) {
          error_item = i;
          error = std::current_exception();
        }
        next = count;
      }
    }
  };
  {
    std::vector<std::jthread> threads;
    try {
      for (size_t t = 1; t < workers; ++t) threads.emplace_back(work);
    } catch (const std::system_error&) {
      // The system gives no more threads: those that are there do the work.
    }
    work();
  }
  if (error) std::rethrow_exception(error);
}

}  // namespace s3lam
