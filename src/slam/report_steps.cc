#include "report_steps.h"

#include <algorithm>
#include <utility>

#include "s3lam/base/log.h"
#include "s3lam/slam/export.h"
#include "s3lam/slam/stops.h"

namespace s3lam::slam {
namespace {

/// Where each localised frame is, in whichever map.
std::vector<std::optional<FrameView>> ViewsOf(
    const Submaps& maps, const std::vector<std::vector<FrameTrack>>& localized) {
  std::vector<std::optional<FrameView>> views(localized.front().size());
  for (size_t m = 0; m < maps.size(); ++m) {
    for (size_t i = 0; i < views.size(); ++i) {
      const FrameTrack& track = localized[m][i];
      if (!track.tracked) continue;
      views[i] =
          FrameView{static_cast<int>(m), track.cam_from_world, MedianDepth(maps[m]->map(), track)};
    }
  }
  return views;
}

TwoViewVerdict JudgeByTwoViews(const Options& options, const Undistorter& undistorter,
                               const Map& map, const std::vector<FrameTrack>& localized) {
  std::vector<TwoViewCheck> checks =
      CheckTwoViews(options.two_view_check, map, undistorter, options.num_threads);
  TwoViewVerdict verdict{ContradictionOfFrames(checks, localized.size()),
                         std::vector<uint8_t>(localized.size(), 0),
                         std::vector<uint8_t>(localized.size(), 0)};
  std::erase_if(checks, [&](const TwoViewCheck& check) {
    return check.num_matches < options.remapping.min_matches;
  });
  std::vector<double> doubts = ContradictionOfFrames(checks, localized.size());
  std::transform(doubts.begin(), doubts.end(), doubts.begin(), Refutation);
  const MapParts parts = FindParts(map, localized, doubts);
  for (size_t i = 0; i < localized.size(); ++i) {
    if (!localized[i].tracked) continue;
    verdict.is_refuted[i] = doubts[i] >= kRefuted ? 1 : 0;
    verdict.is_cut_off[i] =
        verdict.is_refuted[i] == 0 && parts.of_frame[i] != parts.largest ? 1 : 0;
  }
  return verdict;
}

void AddFrames(const Undistorter& undistorter, const Map& map, int model,
               const std::vector<FrameTrack>& localized, const TwoViewVerdict& verdict,
               Report& report) {
  for (int i = 0; i < static_cast<int>(localized.size()); ++i) {
    if (!localized[i].tracked) continue;
    FrameReport& frame = report.frames[i];
    frame = DescribeFrame(undistorter, map, i, localized[i]);
    frame.map = model;
    frame.contradiction = verdict.contradictions[i];
    frame.is_cut_off = verdict.is_cut_off[i] != 0;
    frame.trust = FrameTrust(frame);
  }
  for (const int k : map.AliveKeyframes()) report.frames[map.keyframe(k).frame].is_keyframe = true;
}

/// A map that is wrong asks for another camera as well, and so does a rolling shutter.
void TellOfBetterPinhole(Report& report) {
  const auto& shutter = report.rolling_shutter;
  const bool rolls = shutter && shutter->is_seen && !shutter->is_compensated;
  if (rolls || IsMostlyRefuted(report.frames)) report.better_pinhole.clear();
  if (report.better_pinhole.empty()) return;
  spdlog::warn(
      "is this the calibration of the camera, and the map right? {}; --camera auto finds a "
      "calibration",
      DescribeBetterPinhole(report.better_pinhole, report.pinhole_cost_share));
}

/// A map may be wrong because of it: it is told of wrong ones, too.
void TellOfRollingShutter(const Report& report) {
  const auto& shutter = report.rolling_shutter;
  if (!shutter || !shutter->is_seen || shutter->is_compensated) return;
  spdlog::warn(
      "the images were taken by a rolling shutter (of about {:.0f} ms), which bends the map: "
      "--set rolling_shutter.mode=compensate corrects for it",
      1e3 * shutter->readout_s);
}

void TellOfDoubt(const Options& options, const std::vector<TwoViewVerdict>& verdicts) {
  size_t in_doubt = 0;
  for (const TwoViewVerdict& verdict : verdicts) {
    for (size_t i = 0; i < verdict.is_refuted.size(); ++i) {
      in_doubt += verdict.is_refuted[i] != 0 || verdict.is_cut_off[i] != 0 ? 1 : 0;
    }
  }
  const double share =
      static_cast<double>(in_doubt) / static_cast<double>(verdicts.front().is_refuted.size());
  if (share <= options.remapping.max_doubt) return;
  spdlog::warn(
      "{:.0f} % of the frames are in doubt: two views refute the map there, or such frames are all "
      "that holds them to the rest; see the stretches that are little trusted",
      100.0 * share);
}

/// A pixel is too large an angle there to tell the motion from others that explain the images as
/// well, or that two views contradict the map.
void WarnOfSmallImages(const Camera& camera) {
  constexpr int kSmallSide = 320;  // px
  if (std::max(camera.width, camera.height) >= kSmallSide) return;
  spdlog::warn(
      "images of {} x {} px are small: the map may be wrong without a sign of it in the report",
      camera.width, camera.height);
}

}  // namespace

std::vector<TwoViewVerdict> JudgeMaps(const Options& options, const Undistorter& undistorter,
                                      const Submaps& maps,
                                      const std::vector<std::vector<FrameTrack>>& localized) {
  std::vector<TwoViewVerdict> verdicts;
  for (size_t m = 0; m < maps.size(); ++m) {
    verdicts.push_back(JudgeByTwoViews(options, undistorter, maps[m]->map(), localized[m]));
  }
  return verdicts;
}

Result MakeResult(const Options& options, const Input& input,
                  const std::vector<std::vector<FrameTrack>>& localized,
                  const std::vector<TwoViewVerdict>& verdicts, RunState& state) {
  Result result;
  Report& report = state.report;
  const Submaps& maps = state.maps;
  report.num_frames = static_cast<int>(state.frames.size());
  report.frames.resize(state.frames.size());
  for (size_t m = 0; m < maps.size(); ++m) {
    const Map& map = maps[m]->map();
    result.models.push_back(Export(input, state.undistorter.camera(), map, localized[m]));
    report.maps.push_back(DescribeMap(result.models[m], *maps[m], localized[m]));
    report.maps[m].loops = std::move(state.loops[m]);
    AddFrames(state.undistorter, map, static_cast<int>(m), localized[m], verdicts[m], report);
  }
  if (report.focal && !report.focal->IsDetermined()) {
    spdlog::warn(
        "the motion does not determine the focal length (sigma {:.1f} of {:.1f} px): it is little "
        "more than a guess, and the map may be distorted; give the camera's calibration",
        report.focal->Sigma(), report.focal->refined);
  }
  if (LosesFramesOfUnknownCamera(report)) {
    spdlog::warn(
        "many frames are not localised, which a wrong focal length can be the reason of: give the "
        "camera's calibration, or begin with {:.1f} px, to which it was refined",
        report.focal->refined);
  }
  WarnOfSmallImages(input.camera);
  TellOfDoubt(options, verdicts);
  TellOfBetterPinhole(report);
  TellOfRollingShutter(report);
  report.stretches = FindStretches(report.frames);
  report.stops = FindStops(ViewsOf(maps, localized), state.undistorter.camera().FocalX());
  result.report = std::move(report);
  return result;
}

}  // namespace s3lam::slam
