#include "s3lam/base/timer.h"

#include <sys/resource.h>

namespace s3lam {

double PeakMemoryMiB() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;  // Linux gives KiB.
}

}  // namespace s3lam
