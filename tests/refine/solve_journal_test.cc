#include "s3lam/refine/solve_journal.h"

#include <gtest/gtest.h>

#include <map>

#include "refine/refine_fixture.h"

namespace s3lam::refine {
namespace {

/// Steps in memory, and how often one was kept.
class KeptSteps : public StepStore {
 public:
  std::optional<std::string> Recall(const std::string& step) override {
    const auto it = steps_.find(step);
    if (it == steps_.end()) return std::nullopt;
    return it->second;
  }
  void Keep(const std::string& step, std::string_view bytes) override {
    steps_[step] = std::string(bytes);
    ++num_kept_;
  }

  [[nodiscard]] size_t num_kept() const { return num_kept_; }

 private:
  std::map<std::string, std::string> steps_;
  size_t num_kept_ = 0;
};

TEST(SolveJournal, ARunThatIsGoneOnWithSolvesNothingAgain) {
  KeptSteps steps;
  Input input = MakeInput(MakeDeskMap());
  input.steps = &steps;
  Output first;
  const Report report = refine::Run(Options(), input, first);
  EXPECT_TRUE(report.iterations.back().with_planes);
  EXPECT_EQ(steps.num_kept(), report.iterations.size() + 1);  // At last points are flattened.
  Output again;
  refine::Run(Options(), input, again);
  EXPECT_EQ(steps.num_kept(), report.iterations.size() + 1);
  EXPECT_TRUE(SameBytes(first.model, again.model));
}

TEST(SolveJournal, StepsOfAnotherRunAreRefused) {
  KeptSteps steps;
  Input input = MakeInput(MakeDeskMap());
  input.steps = &steps;
  Output output;
  refine::Run(WithMode(PlaneMode::kOff), input, output);
  input.model.points.begin()->second.xyz.x() += 1e-6;
  EXPECT_THROW(refine::Run(WithMode(PlaneMode::kOff), input, output), std::runtime_error);
}

}  // namespace
}  // namespace s3lam::refine
