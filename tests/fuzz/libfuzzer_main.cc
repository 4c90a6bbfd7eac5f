// One libFuzzer program for all targets: which one, the environment variable S3LAM_FUZZ_TARGET
// says.

#include <unistd.h>

#include <cstdint>
#include <cstdlib>

#include "fuzz/targets.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const s3lam::fuzz::Target& target = [&]() -> const auto& {
    const char* name = std::getenv("S3LAM_FUZZ_TARGET");
    return s3lam::fuzz::FindTarget(name == nullptr ? "" : name);
  }
  ();
  s3lam::fuzz::RunInput(target, {reinterpret_cast<const char*>(data), size});
  return 0;
}
