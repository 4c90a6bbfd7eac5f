#include "single_thread_scope.h"

#include <dlfcn.h>

#include <mutex>

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

/// What the libraries had before the first of the scopes that live now.
struct Saved {
  std::mutex mutex;
  int num_scopes = 0;
  int blas_threads = 0;
  int openmp_levels = 0;
};

Saved& SavedSettings() {
  static Saved saved;
  return saved;
}

}  // namespace

SingleThreadScope::SingleThreadScope() {
  Saved& saved = SavedSettings();
  const std::lock_guard lock(saved.mutex);
  if (saved.num_scopes++ > 0) return;
  saved.blas_threads = BlasThreads().Exchange(1);
  saved.openmp_levels = OpenMpLevels().Exchange(0);
}

SingleThreadScope::~SingleThreadScope() {
  Saved& saved = SavedSettings();
  const std::lock_guard lock(saved.mutex);
  if (--saved.num_scopes > 0) return;
  BlasThreads().Exchange(saved.blas_threads);
  OpenMpLevels().Exchange(saved.openmp_levels);
}

}  // namespace s3lam::internal
