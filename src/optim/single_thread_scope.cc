#include "single_thread_scope.h"

#include <dlfcn.h>

namespace s3lam::internal {
namespace {

/// A number that a library keeps; without the library it is 0.
class LibrarySetting {
 public:
  LibrarySetting(const char* getter, const char* setter)
      : get_(reinterpret_cast<int (*)()>(dlsym(RTLD_DEFAULT, getter))),
        set_(reinterpret_cast<void (*)(int)>(dlsym(RTLD_DEFAULT, setter))) {}

  /// Sets the number and returns the one before.
  int Exchange(int value) const {
    if (get_ == nullptr || set_ == nullptr) return 0;
    const int before = get_();
    if (before != value) set_(value);
    return before;
  }

 private:
  int (*get_)();
  void (*set_)(int);
};

const LibrarySetting& BlasThreads() {
  static const LibrarySetting setting("openblas_get_num_threads", "openblas_set_num_threads");
  return setting;
}

/// Parallel regions inside one another; none of 0 levels is parallel, whatever number of threads it
/// asks for.
const LibrarySetting& OpenMpLevels() {
  static const LibrarySetting setting("omp_get_max_active_levels", "omp_set_max_active_levels");
  return setting;
}

}  // namespace

SingleThreadScope::SingleThreadScope()
    : blas_threads_(BlasThreads().Exchange(1)), openmp_levels_(OpenMpLevels().Exchange(0)) {}

SingleThreadScope::~SingleThreadScope() {
  BlasThreads().Exchange(blas_threads_);
  OpenMpLevels().Exchange(openmp_levels_);
}

}  // namespace s3lam::internal
