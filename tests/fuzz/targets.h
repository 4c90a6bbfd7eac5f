#pragma once

#include <span>
#include <string_view>

namespace s3lam::fuzz {

/// A parser, fed with bytes of any kind. It may throw InputError or UsageError; anything else that
/// leaves it, and any invariant of what it accepts that does not hold, is a finding.
struct Target {
  std::string_view name;  // Also of its folder of seeds.
  void (*run)(std::string_view bytes);
};

std::span<const Target> Targets();

/// The target of this name; throws std::invalid_argument if there is none.
const Target& FindTarget(std::string_view name);

/// Runs one input, swallowing what a target may throw.
void RunInput(const Target& target, std::string_view bytes);

}  // namespace s3lam::fuzz
