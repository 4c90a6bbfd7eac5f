#include "s3lam/slam/report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "s3lam/slam/two_view_check.h"

namespace s3lam::slam {
namespace {

constexpr int kEnoughInliers = 60;
constexpr double kEnoughSpread = 0.5;
constexpr double kMaxRelativeFocalSigma = 0.02;
constexpr double kCommonFocalSigma = 0.01;  // A choice; between parts nothing shows it.
constexpr double kGoodTrust = 0.5;
constexpr double kManyLost = 0.2;  // Of the frames.
constexpr double kCutOffTrust = 0.4;
constexpr size_t kNumDoubts = 5;
constexpr int kMinStretchFrames = 5;  // Shorter weak or good ones join what is around them.

const char* Name(StretchReport::State state) {
  switch (state) {
    case StretchReport::State::kLost:
      return "lost";
    case StretchReport::State::kWeak:
      return "weak";
    case StretchReport::State::kGood:
      return "good";
  }
  return "";
}

StretchReport::State StateOf(int map, double trust) {
  if (map < 0) return StretchReport::State::kLost;
  return trust >= kGoodTrust ? StretchReport::State::kGood : StretchReport::State::kWeak;
}

/// In the order of StretchReport::Doubt.
std::array<double, kNumDoubts> TrustFactors(const FrameReport& frame) {
  return {std::min(1.0, static_cast<double>(frame.num_inliers) / kEnoughInliers),
          std::min(1.0, frame.spread / kEnoughSpread), 1.0 / std::max(1.0, frame.rms_sigma),
          1.0 - Refutation(frame.contradiction), frame.is_cut_off ? kCutOffTrust : 1.0};
}

bool IsRefuted(const FrameReport& frame) { return Refutation(frame.contradiction) >= kRefuted; }

int Length(const StretchReport& stretch) { return stretch.last_frame - stretch.first_frame + 1; }

double MeanTrust(const StretchReport& a, const StretchReport& b) {
  return (Length(a) * a.mean_trust + Length(b) * b.mean_trust) / (Length(a) + Length(b));
}

void Append(const StretchReport& stretch, std::vector<StretchReport>& stretches) {
  if (!stretches.empty()) {
    StretchReport& last = stretches.back();
    if (last.map == stretch.map && (last.state == stretch.state || last.map < 0)) {
      last.mean_trust = MeanTrust(last, stretch);
      last.min_trust = std::min(last.min_trust, stretch.min_trust);
      last.last_frame = stretch.last_frame;
      return;
    }
  }
  stretches.push_back(stretch);
}

/// Short stretches that differ in trust alone from the one before or after join it, unless its mean
/// trust would then belie its state.
std::vector<StretchReport> JoinShort(const std::vector<StretchReport>& stretches) {
  std::vector<StretchReport> joined;
  for (size_t i = 0; i < stretches.size(); ++i) {
    StretchReport stretch = stretches[i];
    const auto can_join = [&](const StretchReport& other) {
      return other.map == stretch.map &&
             StateOf(other.map, MeanTrust(other, stretch)) == other.state;
    };
    const bool is_short = stretch.map >= 0 && Length(stretch) < kMinStretchFrames;
    if (is_short && !joined.empty() && can_join(joined.back())) {
      stretch.state = joined.back().state;
    } else if (is_short && i + 1 < stretches.size() && can_join(stretches[i + 1])) {
      stretch.state = stretches[i + 1].state;
    }
    Append(stretch, joined);
  }
  return joined;
}

/// The factor of trust that is lowest over the frames of the stretch.
StretchReport::Doubt WorstDoubt(const std::vector<FrameReport>& frames,
                                const StretchReport& stretch) {
  std::array<double, kNumDoubts> sums{};
  for (int i = stretch.first_frame; i <= stretch.last_frame; ++i) {
    const std::array<double, kNumDoubts> factors = TrustFactors(frames[i]);
    for (size_t f = 0; f < sums.size(); ++f) sums[f] += factors[f];
  }
  return static_cast<StretchReport::Doubt>(std::min_element(sums.begin(), sums.end()) -
                                           sums.begin());
}

nlohmann::json ToJson(const LoopReport& loop) {
  return {{"frames", {loop.frame_a, loop.frame_b}},
          {"points", loop.num_points},
          {"correction_deg", loop.correction_deg},
          {"correction_share", loop.correction_share},
          {"correction_scale", loop.correction_scale}};
}

/// What was decided about the motion that the map starts from.
nlohmann::json InitialMotionToJson(const MapReport& map) {
  const bool is_ambiguous = map.initial_other_motions > 0;
  return {
      {"error", map.initial_error},
      {"rotation_only_error", map.initial_rotation_only_error},
      {"planar_ambiguity", is_ambiguous},
      {"other_motions", map.initial_other_motions},
      {"other_error", is_ambiguous ? nlohmann::json(map.initial_other_error) : nlohmann::json()}};
}

nlohmann::json ToJson(const StopReport& stop) {
  const bool turns = stop.kind == StopReport::Kind::kRotation;
  return {{"frames", {stop.first_frame, stop.last_frame}},
          {"map", stop.map},
          {"kind", turns ? "rotation" : "standstill"},
          {"turn_deg", stop.turn_deg}};
}

nlohmann::json ToJson(const MapReport& map, size_t index) {
  nlohmann::json loops = nlohmann::json::array();
  for (const LoopReport& loop : map.loops.closed) loops.push_back(ToJson(loop));
  return {{"folder", index == 0 ? "." : std::to_string(index)},
          {"frames_localized", map.num_frames},
          {"first_frame", map.first_frame},
          {"last_frame", map.last_frame},
          {"keyframes", map.num_keyframes},
          {"points", map.num_points},
          {"observations", map.num_observations},
          {"relocalizations", map.num_relocalizations},
          {"rms_px", map.rms_px},
          {"aligned_sigmas_px", map.aligned_sigmas_px},
          {"mean_track_length", map.mean_track_length},
          {"initial_frames", map.initial_frames},
          {"initial_parallax_deg", map.initial_parallax_deg},
          {"initial_motion", InitialMotionToJson(map)},
          {"loops_closed", loops},
          {"loops_rejected", map.loops.num_rejected}};
}

nlohmann::json ToJson(const StretchReport& stretch) {
  return {{"frames", {stretch.first_frame, stretch.last_frame}},
          {"map", stretch.map},
          {"state", Name(stretch.state)},
          {"doubt", stretch.doubt ? nlohmann::json(Describe(*stretch.doubt)) : nlohmann::json()},
          {"mean_trust", stretch.mean_trust},
          {"min_trust", stretch.min_trust}};
}

nlohmann::json ToJson(const FocalReport& focal) {
  return {{"guess_px", focal.guess},
          {"guess_relative_sigma", focal.guess_relative_sigma},
          {"refined_px", focal.refined},
          {"sigma_px", focal.Sigma()},
          {"noise_sigma_px", focal.noise_sigma},
          {"parts_sigma_px", focal.parts_sigma},
          {"determined", focal.IsDetermined()}};
}

nlohmann::json ToJson(const FrameReport& frame) {
  return {{"localized", frame.localized()},
          {"map", frame.map},
          {"keyframe", frame.is_keyframe},
          {"inliers", frame.num_inliers},
          {"spread", frame.spread},
          {"rms_sigma", frame.rms_sigma},
          {"contradiction", frame.contradiction},
          {"cut_off", frame.is_cut_off},
          {"trust", frame.trust}};
}

template <typename T>
nlohmann::json ToJsonArray(const std::vector<T>& items) {
  nlohmann::json array = nlohmann::json::array();
  for (const T& item : items) array.push_back(ToJson(item));
  return array;
}

}  // namespace

double FocalReport::Sigma() const {
  return std::hypot(noise_sigma, parts_sigma, kCommonFocalSigma * refined);
}

bool FocalReport::IsDetermined() const { return Sigma() <= kMaxRelativeFocalSigma * refined; }

bool LosesFramesOfUnknownCamera(const Report& report) {
  const auto num_lost = std::count_if(report.frames.begin(), report.frames.end(),
                                      [](const FrameReport& frame) { return !frame.localized(); });
  return report.focal && static_cast<double>(num_lost) > kManyLost * report.num_frames;
}

double FrameTrust(const FrameReport& frame) {
  double trust = 1.0;
  for (const double factor : TrustFactors(frame)) trust *= factor;
  return trust;
}

const char* Describe(StretchReport::Doubt doubt) {
  switch (doubt) {
    case StretchReport::Doubt::kFewPoints:
      return "few points";
    case StretchReport::Doubt::kSmallPart:
      return "points in a small part of the image";
    case StretchReport::Doubt::kLargeResiduals:
      return "large residuals";
    case StretchReport::Doubt::kRefuted:
      return "refuted by two views";
    case StretchReport::Doubt::kCutOff:
      return "cut off by refuted frames";
  }
  return "";
}

bool IsMostlyRefuted(const std::vector<FrameReport>& frames) {
  int num_of_map = 0;
  int num_refuted = 0;
  for (const FrameReport& frame : frames) {
    if (frame.map != 0) continue;
    ++num_of_map;
    if (IsRefuted(frame)) ++num_refuted;
  }
  return 2 * num_refuted > num_of_map;
}

std::vector<StretchReport> FindStretches(const std::vector<FrameReport>& frames) {
  std::vector<StretchReport> stretches;
  for (int i = 0; i < static_cast<int>(frames.size()); ++i) {
    StretchReport frame;
    frame.first_frame = frame.last_frame = i;
    frame.map = frames[i].map;
    frame.mean_trust = frame.min_trust = frames[i].trust;
    frame.state = StateOf(frame.map, frame.mean_trust);
    Append(frame, stretches);
  }
  stretches = JoinShort(stretches);
  for (StretchReport& stretch : stretches) {
    if (stretch.state == StretchReport::State::kWeak) stretch.doubt = WorstDoubt(frames, stretch);
  }
  return stretches;
}

nlohmann::json ToJson(const RollingShutterReport& shutter) {
  return {
      {"seen", shutter.is_seen},          {"compensated", shutter.is_compensated},
      {"cost_share", shutter.cost_share}, {"readout_s", shutter.readout_s},
      {"sigma_s", shutter.sigma_s},       {"direction", ShutterDirectionName(shutter.direction)}};
}

nlohmann::json ToJson(const Report& report) {
  const MapReport main = report.maps.empty() ? MapReport{} : report.maps.front();
  nlohmann::json maps = nlohmann::json::array();
  for (size_t i = 0; i < report.maps.size(); ++i) maps.push_back(ToJson(report.maps[i], i));
  const auto of_check = [&](const auto& figure) {
    return report.calibration_was_checked ? nlohmann::json(figure) : nlohmann::json();
  };
  return {{"frames", report.num_frames},
          {"frames_localized", main.num_frames},
          {"keyframes", main.num_keyframes},
          {"points", main.num_points},
          {"observations", main.num_observations},
          {"relocalizations", main.num_relocalizations},
          {"rms_px", main.rms_px},
          {"mean_track_length", main.mean_track_length},
          {"initial_frames", main.initial_frames},
          {"initial_parallax_deg", main.initial_parallax_deg},
          {"loops_closed", main.loops.closed.size()},
          {"maps", maps},
          {"maps_merged", report.num_merged_maps},
          {"mapped_again",
           {{"attempts", report.remapping.attempts},
            {"doubt_before", report.remapping.doubt_before},
            {"doubt", report.remapping.doubt}}},
          {"camera_was_refined", report.camera_was_refined},
          {"distortion_cost_share", of_check(report.distortion_cost_share)},
          {"pinhole_cost_share", of_check(report.pinhole_cost_share)},
          {"better_pinhole", of_check(report.better_pinhole)},
          {"rolling_shutter",
           report.rolling_shutter ? ToJson(*report.rolling_shutter) : nlohmann::json()},
          {"focal_length", report.focal ? ToJson(*report.focal) : nlohmann::json()},
          {"seconds", report.seconds},
          {"stretches", ToJsonArray(report.stretches)},
          {"stops", ToJsonArray(report.stops)},
          {"per_frame", ToJsonArray(report.frames)}};
}

}  // namespace s3lam::slam
