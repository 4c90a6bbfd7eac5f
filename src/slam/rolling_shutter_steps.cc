#include "rolling_shutter_steps.h"

#include <algorithm>
#include <cmath>

#include "calibration_steps.h"
#include "localization_steps.h"
#include "s3lam/base/log.h"
#include "s3lam/base/statistics.h"

namespace s3lam::slam {
namespace {

/// With points held; below it no more is tried. Global shutters, real and rendered, came to less
/// than a tenth of it.
constexpr double kLikelyCostShare = 0.003;
constexpr double kSeenCostShare = 0.01;  // With poses and points free.
constexpr double kSeenSigmas = 5.0;
constexpr int kMaxRounds = 6;      // Each with the motion that the last one has corrected.
constexpr int kPassesBetween = 2;  // As long as the motion is that without it, it hides itself.
constexpr double kSettledChange = 0.02;  // Of the readout time, from round to round.

class Compensation {
 public:
  Compensation(const Options& options, const Input& input, const Undistorter& undistorter,
               const Submaps& maps, std::vector<std::vector<FrameTrack>>& localized)
      : options_(options),
        input_(input),
        undistorter_(undistorter),
        maps_(maps),
        localized_(localized) {
    FindMotionsInMaps();
  }

  [[nodiscard]] ReadoutShares Shares() const {
    std::vector<MapInMotion> maps;
    for (size_t m = 0; m < maps_.size(); ++m) maps.push_back({maps_[m]->map(), motions_[m]});
    return FindReadoutShares(undistorter_, maps);
  }

  /// The readout time along an axis beyond what is corrected, by the largest map.
  [[nodiscard]] std::optional<ReadoutRefinement> Refine(const Eigen::Vector2d& axis) const {
    const MapInMotion map{maps_.front()->map(), motions_.front()};
    return RefineReadout(options_.self_calibration, undistorter_.camera(),
                         MakeReadoutProblem(undistorter_, map, axis));
  }

  /// Corrects by this readout time, and adjusts everything.
  void Correct(const Readout& readout) {
    if (!correction_) correction_.emplace(maps_.front()->map(), input_.names.size());
    for (size_t m = 0; m < maps_.size(); ++m) {
      correction_->Apply(readout, undistorter_, localized_[m], motions_[m], maps_[m]->map());
    }
    AdjustFinally(options_, undistorter_, maps_);
    RefineInMaps(options_, maps_, localized_);
    FindMotionsInMaps();
  }

 private:
  void FindMotionsInMaps() {
    motions_.clear();
    for (const auto& localized : localized_) {
      motions_.push_back(FindMotions(input_.times_s, localized));
    }
  }

  const Options& options_;
  const Input& input_;
  const Undistorter& undistorter_;
  const Submaps& maps_;
  std::vector<std::vector<FrameTrack>>& localized_;
  std::vector<std::vector<std::optional<FrameMotion>>> motions_;  // By map.
  std::optional<ShutterCorrection> correction_;                   // From the first correction on.
};

/// Returns the axis of the image along which a shutter is most likely a rolling one.
Eigen::Vector2d LookForShutter(const Compensation& compensation, RollingShutterReport& report) {
  const ReadoutShares shares = compensation.Shares();
  const bool along_x = shares.right > shares.down;
  Eigen::Vector2d axis = along_x ? Eigen::Vector2d::UnitX() : Eigen::Vector2d::UnitY();
  report.cost_share = std::max(shares.right, shares.down);
  if (report.cost_share < kLikelyCostShare) return axis;
  const auto refined = compensation.Refine(axis);
  if (!refined) return axis;
  report.cost_share = refined->cost_decrease;
  report.readout_s = std::abs(refined->readout_s);
  report.sigma_s = refined->sigma_s;
  report.direction = DirectionOf(refined->readout_s * axis);
  report.is_seen =
      report.cost_share >= kSeenCostShare && report.readout_s >= kSeenSigmas * report.sigma_s;
  return axis;
}

void CorrectByKnown(const RollingShutterOptions& options, Compensation& compensation,
                    RollingShutterReport& report) {
  const Readout readout = MakeReadout(options.readout_s, options.direction);
  for (int round = 0; round < kMaxRounds; ++round) compensation.Correct(readout);
  report.readout_s = options.readout_s;
  report.sigma_s = 0.0;
  report.direction = options.direction;
  report.is_compensated = true;
}

void CorrectByEstimated(const Eigen::Vector2d& axis, double max_readout_s,
                        Compensation& compensation, RollingShutterReport& report) {
  double readout_s = 0.0;
  bool is_settled = false;
  for (int round = 0; round < kMaxRounds && !is_settled; ++round) {
    const auto refined = compensation.Refine(axis);
    if (!refined) break;
    const double next = std::clamp(readout_s + refined->readout_s, -max_readout_s, max_readout_s);
    is_settled = std::abs(refined->readout_s) <= kSettledChange * std::abs(next);
    readout_s = next;
    report.readout_s = std::abs(readout_s);
    report.sigma_s = refined->sigma_s;
    report.direction = DirectionOf(readout_s * axis);
    report.is_compensated = true;
    for (int pass = 0; pass < kPassesBetween; ++pass) compensation.Correct(readout_s * axis);
  }
  if (is_settled) return;
  spdlog::warn(
      "the readout time of the rolling shutter does not settle: what is corrected is {:.1f} ms; "
      "give rolling_shutter.readout_s",
      1e3 * report.readout_s);
}

}  // namespace

void HandleRollingShutter(const Options& options, const Input& input,
                          const Undistorter& undistorter, const Submaps& maps,
                          std::vector<std::vector<FrameTrack>>& localized, Report& report) {
  const RollingShutterOptions& shutter = options.rolling_shutter;
  if (shutter.mode == RollingShutterOptions::Mode::kOff) return;
  Compensation compensation(options, input, undistorter, maps, localized);
  RollingShutterReport& result = report.rolling_shutter.emplace();
  const Eigen::Vector2d axis = LookForShutter(compensation, result);
  if (shutter.mode == RollingShutterOptions::Mode::kCompensate) {
    if (shutter.readout_s > 0.0) {
      CorrectByKnown(shutter, compensation, result);
    } else if (result.is_seen) {
      CorrectByEstimated(axis, MedianStep(input.times_s), compensation, result);
    } else {
      spdlog::info("no rolling shutter is seen");
    }
  }
  if (result.is_compensated) {
    spdlog::info("corrected for a rolling shutter of {:.1f} ms ({})", 1e3 * result.readout_s,
                 ShutterDirectionName(result.direction));
  }
}

}  // namespace s3lam::slam
