#include "rolling_shutter_steps.h"

#include <algorithm>
#include <cmath>

#include "calibration_steps.h"
#include "localization_steps.h"
#include "s3lam/base/log.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/statistics.h"

namespace s3lam::slam {
namespace {

/// On real and rendered sequences, global shutters came to less than a tenth of it.
constexpr double kSeenCostShare = 0.003;
constexpr double kSeenSigmas = 3.0;
constexpr int kMaxRounds = 6;
constexpr double kSettledChange = 0.02;  // Of the readout time, from round to round.
/// Part of what is left of the readout time that points, once adjusted, still let be seen.
constexpr double kMinResponse = 0.03;

bool IsSeen(const ReadoutFit& fit) {
  return fit.cost_share >= kSeenCostShare && std::abs(fit.seconds) >= kSeenSigmas * fit.sigma_s;
}

/// The readout time at which nothing more of it is asked for. What is asked for falls in proportion
/// to what is missing, by a factor that depends on the motion.
class ReadoutSearch {
 public:
  explicit ReadoutSearch(double max_readout_s) : max_readout_s_(max_readout_s) {}

  /// The next readout time along the axis to adjust with, from what is asked for beyond the one
  /// before; empty if what was asked for did not answer to it.
  std::optional<double> Next(double asked_s) {
    double step = asked_s;  // At the start: too short, for points have explained some of it away.
    if (has_last_) {
      response_ = (last_asked_s_ - asked_s) / last_step_s_;
      if (!(response_ > kMinResponse)) return std::nullopt;
      step = asked_s / response_;
    }
    const double next = std::clamp(readout_s_ + step, -max_readout_s_, max_readout_s_);
    last_step_s_ = next - readout_s_;
    last_asked_s_ = asked_s;
    has_last_ = true;
    readout_s_ = next;
    return next;
  }
  [[nodiscard]] bool IsSettled() const {
    return has_last_ && std::abs(last_step_s_) <= kSettledChange * std::abs(readout_s_) &&
           std::abs(readout_s_) < max_readout_s_;
  }
  /// Of what is asked for to what is missing.
  [[nodiscard]] double response() const { return response_; }

 private:
  double max_readout_s_;
  double readout_s_ = 0.0;
  bool has_last_ = false;
  double last_step_s_ = 0.0;
  double last_asked_s_ = 0.0;
  double response_ = 1.0;
};

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

  [[nodiscard]] ReadoutFits Fit() const {
    std::vector<LocalizedMap> maps;
    for (size_t m = 0; m < maps_.size(); ++m) {
      maps.push_back({maps_[m]->map(), localized_[m], motions_[m]});
    }
    return FitReadout(undistorter_, maps);
  }

  /// Corrects by this readout time, and adjusts everything.
  void Correct(const Readout& readout) {
    if (!correction_) correction_.emplace(maps_.front()->map(), input_.names.size());
    for (size_t m = 0; m < maps_.size(); ++m) {
      correction_->Apply(readout, undistorter_, localized_[m], motions_[m], maps_[m]->map());
    }
    if (options_.second_pass.patches.enabled) {
      AdjustAligned(options_, undistorter_, maps_);
    } else {
      AdjustMaps(options_, maps_);
    }
    for (size_t m = 0; m < maps_.size(); ++m) RefinePoses(*maps_[m], localized_[m]);
    FindMotionsInMaps();
  }

  /// After the last correction: keyframes that lost too many of their points are none.
  void Finish() {
    EraseWeakKeyframes(options_, maps_);
    for (size_t m = 0; m < maps_.size(); ++m) RefinePoses(*maps_[m], localized_[m]);
  }

 private:
  void FindMotionsInMaps() {
    motions_.clear();
    for (const auto& localized : localized_) {
      motions_.push_back(FindMotions(input_.times_s, localized));
    }
  }

  /// Of all frames in the map as it is now: keyframes are where they are.
  void RefinePoses(MapBuilder& builder, std::vector<FrameTrack>& localized) const {
    const Map& map = builder.map();
    std::vector<int> keyframe_of_frame(localized.size(), kNoIndex);
    for (const int k : map.AliveKeyframes()) keyframe_of_frame[map.keyframe(k).frame] = k;
    ParallelFor(localized.size(), options_.num_threads, [&](size_t i) {
      FrameTrack& track = localized[i];
      if (!track.tracked) return;
      if (const int k = keyframe_of_frame[i]; k != kNoIndex) {
        track.cam_from_world = map.keyframe(k).cam_from_world;
        track.matches = map.MatchesOf(k);
        return;
      }
      std::erase_if(track.matches,
                    [&](const PointMatch& match) { return !map.point(match.point).alive; });
      const int num_inliers =
          builder.tracker().Refine(map, static_cast<int>(i), track.cam_from_world, track.matches);
      if (num_inliers < options_.min_localization_inliers) track = {};
    });
  }

  const Options& options_;
  const Input& input_;
  const Undistorter& undistorter_;
  const Submaps& maps_;
  std::vector<std::vector<FrameTrack>>& localized_;
  std::vector<std::vector<std::optional<FrameMotion>>> motions_;  // By map.
  std::optional<ShutterCorrection> correction_;                   // From the first correction on.
};

void CorrectByKnown(const RollingShutterOptions& options, Compensation& compensation,
                    RollingShutterReport& report) {
  constexpr int kRounds = 2;  // The second with motions that the first has corrected.
  const Readout readout = MakeReadout(options.readout_s, options.direction);
  for (int round = 0; round < kRounds; ++round) compensation.Correct(readout);
  report.readout_s = options.readout_s;
  report.sigma_s = 0.0;
  report.direction = options.direction;
  report.is_compensated = true;
}

void CorrectByEstimated(bool along_x, double max_readout_s, Compensation& compensation,
                        RollingShutterReport& report) {
  const Eigen::Vector2d axis = along_x ? Eigen::Vector2d::UnitX() : Eigen::Vector2d::UnitY();
  ReadoutSearch search(max_readout_s);
  for (int round = 0; round < kMaxRounds && !search.IsSettled(); ++round) {
    const ReadoutFits fits = compensation.Fit();
    const ReadoutFit& fit = along_x ? fits.right : fits.down;
    const auto readout_s = search.Next(fit.seconds);
    if (!readout_s) break;
    report.readout_s = std::abs(*readout_s);
    report.sigma_s = fit.sigma_s / search.response();
    report.direction = DirectionOf(*readout_s * axis);
    report.is_compensated = true;
    compensation.Correct(*readout_s * axis);
  }
  if (search.IsSettled()) return;
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
  const double interval_s = MedianStep(input.times_s);
  Compensation compensation(options, input, undistorter, maps, localized);
  const ReadoutFits fits = compensation.Fit();
  const bool along_x = fits.right.cost_share > fits.down.cost_share;
  const ReadoutFit& fit = along_x ? fits.right : fits.down;
  RollingShutterReport& result = report.rolling_shutter.emplace();
  result.is_seen = IsSeen(fit);
  result.cost_share = fit.cost_share;
  result.readout_s = std::abs(fit.seconds);
  result.sigma_s = fit.sigma_s;
  result.direction = DirectionOf(along_x ? Readout{fit.seconds, 0.0} : Readout{0.0, fit.seconds});
  if (shutter.mode == RollingShutterOptions::Mode::kCompensate) {
    if (shutter.readout_s > 0.0) {
      CorrectByKnown(shutter, compensation, result);
    } else if (result.is_seen) {
      CorrectByEstimated(along_x, interval_s, compensation, result);
    } else {
      spdlog::info("no rolling shutter is seen");
    }
  }
  if (result.is_compensated) {
    compensation.Finish();
    spdlog::info("corrected for a rolling shutter of {:.1f} ms ({})", 1e3 * result.readout_s,
                 ShutterDirectionName(result.direction));
  }
}

}  // namespace s3lam::slam
