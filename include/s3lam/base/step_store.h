#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace s3lam {

/// Where a long run keeps what its steps lead to, so that another run with the same input and
/// options can go on from there. That is sound because runs are deterministic: what a step leads to
/// depends on the input, the options and the steps before it alone.
class StepStore {
 public:
  virtual ~StepStore() = default;

  /// What an earlier run kept for this step, if it is to be gone on with.
  virtual std::optional<std::string> Recall(const std::string& step) = 0;
  /// Replaces what was kept for the step before. Throws std::runtime_error if it cannot be kept.
  virtual void Keep(const std::string& step, std::string_view bytes) = 0;
};

}  // namespace s3lam
