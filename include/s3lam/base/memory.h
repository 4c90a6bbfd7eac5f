#pragma once

#include <cstdint>
#include <string_view>

namespace s3lam {

/// Memory this process may still take [bytes]: the least of what the machine has free, what its
/// control group leaves and what `ulimit -v` allows.
uint64_t AvailableMemory();

/// Throws std::runtime_error saying what needs how much and how much there is, if `bytes` are more
/// than AvailableMemory(). For what is foreseen to be large: better one clear line now than being
/// killed later.
void RequireMemory(uint64_t bytes, std::string_view what);

}  // namespace s3lam
