#pragma once

#include <functional>
#include <vector>

#include "s3lam/base/step_store.h"
#include "s3lam/base/timer.h"
#include "s3lam/slam/loop_closer.h"
#include "s3lam/slam/report.h"
#include "s3lam/slam/submaps.h"

namespace s3lam::slam {

/// What the steps of a run have come to, as far as later ones need it.
struct RunState {
  std::vector<FrameFeatures> frames;
  Undistorter undistorter;
  SubmapsUnderWay tracking;
  Submaps maps;
  std::vector<LoopClosingReport> loops;  // Per map, as far as they are closed.
  std::vector<uint8_t> camera_stays;     // Per refinement of a camera that is not known.
  Report report;                         // As far as the steps fill it.
};

/// The features of all frames, kept or, if they are not, extracted and kept. `store` may be null.
std::vector<FrameFeatures> KeptFeatures(StepStore* store,
                                        const std::function<std::vector<FrameFeatures>()>& extract);

/// Carries out the steps of a run one after another and keeps the state after each. A run that goes
/// on with another one begins with the state that was kept last, and leaves out the steps that are
/// in it.
class Steps {
 public:
  /// `store` may be null: nothing is kept. `make_builder` is for the maps of the state.
  Steps(StepStore* store, double interval_s, const MapBuilderFactory& make_builder,
        RunState& state);

  void Do(const std::function<void()>& step);
  /// In the middle of the tracking: keeps the state if that was not done for the interval.
  void KeepNowAndThen();

 private:
  void Keep();
  template <typename A>
  void Transfer(A& archive);
  template <typename A>
  void TransferFeatures(A& archive);

  StepStore* store_;
  double interval_s_;
  const MapBuilderFactory& make_builder_;
  RunState& state_;
  const Camera camera_;   // As given.
  int num_done_ = 0;      // Steps, of this run or in the state it began with.
  int num_left_out_ = 0;  // Of those in the state it began with.
  Timer since_kept_;
};

}  // namespace s3lam::slam
