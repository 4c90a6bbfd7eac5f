#pragma once

namespace s3lam::internal {

/// While it lives, OpenBLAS and OpenMP work on one thread, where the program has them: CHOLMOD
/// hands them pieces so small that their other threads do little but wait for the next one,
/// spinning; and how they share a sum would depend on their number. Not for several threads at a
/// time: both keep one setting for all.
class SingleThreadScope {
 public:
  SingleThreadScope();
  ~SingleThreadScope();
  SingleThreadScope(const SingleThreadScope&) = delete;
  SingleThreadScope& operator=(const SingleThreadScope&) = delete;

 private:
  int blas_threads_ = 0;
  int openmp_levels_ = 0;
};

}  // namespace s3lam::internal
