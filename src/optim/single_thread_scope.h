#pragma once

namespace s3lam::internal {

/// While it lives, OpenBLAS and OpenMP work on one thread, where the program has them: CHOLMOD
/// hands them pieces so small that their other threads do little but wait for the next one,
/// spinning; and how they share a sum would depend on their number. Both keep one setting for all
/// threads: it is restored when the last scope of any thread ends.
class SingleThreadScope {
 public:
  SingleThreadScope();
  ~SingleThreadScope();
  SingleThreadScope(const SingleThreadScope&) = delete;
  SingleThreadScope& operator=(const SingleThreadScope&) = delete;
};

}  // namespace s3lam::internal
