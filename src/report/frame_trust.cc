#include "s3lam/report/frame_trust.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace s3lam::report {
namespace {

using nlohmann::json;

constexpr int kMaxFrames = 100'000'000;
constexpr size_t kMaxListed = 8;  // A sentence that lists more is read by nobody.

const json& Member(const json& object, const char* key) {
  static const json kNone;
  if (!object.is_object()) return kNone;
  const auto it = object.find(key);
  return it == object.end() ? kNone : *it;
}

std::optional<double> Number(const json& value) {
  if (!value.is_number() || !std::isfinite(value.get<double>())) return std::nullopt;
  return value.get<double>();
}

std::optional<int> Count(const json& value) {
  const auto number = Number(value);
  if (!value.is_number_integer() || !number || *number < 0 || *number > kMaxFrames) {
    return std::nullopt;
  }
  return static_cast<int>(*number);
}

std::string Text(const json& value) {
  return value.is_string() ? value.get<std::string>() : std::string();
}

std::optional<FrameState> State(const json& value) {
  const std::string name = Text(value);
  if (name == "good") return FrameState::kGood;
  if (name == "weak") return FrameState::kWeak;
  if (name == "lost") return FrameState::kLost;
  return std::nullopt;
}

std::optional<FrameStretch> ParseStretch(const json& entry, int first) {
  const json& frames = Member(entry, "frames");
  if (!frames.is_array() || frames.size() != 2) return std::nullopt;
  const auto last = Count(frames[1]);
  const auto state = State(Member(entry, "state"));
  if (Count(frames[0]) != first || !last || *last < first || !state) return std::nullopt;
  return FrameStretch{first, *last, Count(Member(entry, "map")).value_or(0), *state,
                      Number(Member(entry, "mean_trust"))};
}

std::vector<FrameStretch> ParseStretches(const json& list) {
  std::vector<FrameStretch> stretches;
  if (!list.is_array()) return stretches;
  for (const json& entry : list) {
    const auto stretch = ParseStretch(entry, stretches.empty() ? 0 : stretches.back().last + 1);
    if (!stretch) return {};
    stretches.push_back(*stretch);
  }
  return stretches;
}

std::vector<TrustedFrame> ParseFrames(const json& list, int num_frames) {
  std::vector<TrustedFrame> frames;
  if (!list.is_array() || list.size() != static_cast<size_t>(num_frames)) return frames;
  for (const json& entry : list) {
    const auto trust = Number(Member(entry, "trust"));
    if (!trust) return {};
    frames.push_back({Count(Member(entry, "map")).value_or(-1),
                      Member(entry, "keyframe") == json(true), std::clamp(*trust, 0.0, 1.0)});
  }
  return frames;
}

std::string Span(int first, int last) {
  return first == last ? fmt::format("{}", first) : fmt::format("{} to {}", first, last);
}

/// Of a list: the first, and how many more there are.
std::string Join(const std::vector<std::string>& parts) {
  const size_t listed = std::min(parts.size(), kMaxListed);
  std::string text;
  for (size_t i = 0; i < listed; ++i) text += (i > 0 ? ", " : "") + parts[i];
  if (parts.size() > listed) text += fmt::format(" and {} more", parts.size() - listed);
  return text;
}

void AddStretchDoubt(const FrameTrust& trust, FrameState state, const char* what,
                     std::vector<std::string>& doubts) {
  std::vector<std::string> spans;
  int count = 0;
  double sum = 0.0;
  bool is_mean_known = state == FrameState::kWeak;
  for (const FrameStretch& stretch : trust.stretches) {
    if (stretch.state != state) continue;
    count += stretch.Length();
    sum += stretch.mean_trust.value_or(0.0) * stretch.Length();
    is_mean_known &= stretch.mean_trust.has_value();
    spans.push_back(Span(stretch.first, stretch.last));
  }
  if (count == 0) return;
  const std::string mean =
      is_mean_known ? fmt::format(", mean trust {:.2f} of 1", sum / count) : "";
  doubts.push_back(fmt::format("{}: frames {} ({} of {}{}).", what, Join(spans), count,
                               trust.NumFrames(), mean));
}

void AddMapDoubt(const json& slam, std::vector<std::string>& doubts) {
  const json& maps = Member(slam, "maps");
  if (!maps.is_array() || maps.size() < 2) return;
  std::vector<std::string> apart;
  for (size_t m = 1; m < maps.size(); ++m) {
    const auto frames = Count(Member(maps[m], "frames_localized"));
    const auto first = Count(Member(maps[m], "first_frame"));
    const auto last = Count(Member(maps[m], "last_frame"));
    if (!frames || !first || !last) continue;
    apart.push_back(fmt::format("1_slam/{} ({} of the frames {})", Text(Member(maps[m], "folder")),
                                *frames, Span(*first, *last)));
  }
  if (apart.empty()) return;
  doubts.push_back(fmt::format(
      "The sequence falls apart: what does not meet the map shown is in {}.", Join(apart)));
}

void AddFocalDoubt(const json& slam, std::vector<std::string>& doubts) {
  const json& focal = Member(slam, "focal_length");
  if (Member(focal, "determined") != json(false)) return;
  const auto refined = Number(Member(focal, "refined_px"));
  const auto sigma = Number(Member(focal, "sigma_px"));
  const std::string value =
      refined && sigma ? fmt::format(": {:.1f} px, sigma {:.1f}", *refined, *sigma) : "";
  doubts.push_back(fmt::format("The images do not determine the focal length{}.", value));
}

/// " (25 % of the reprojection cost)"; empty if the share is not known.
std::string ShareOfCost(const json& object, const char* key) {
  const auto share = Number(Member(object, key));
  return share ? fmt::format(" ({:.0f} % of the reprojection cost)", 100.0 * *share) : "";
}

/// `object` is one of s3-refine's cameras.
void AddDistortionDoubt(const json& object, const std::string& whose,
                        std::vector<std::string>& doubts) {
  if (Member(object, "distortion_is_doubtful") != json(true)) return;
  doubts.push_back(fmt::format(
      "The calibration{} is in doubt: another lens distortion would explain the images much "
      "better{}.",
      whose, ShareOfCost(object, "distortion_cost_share")));
}

/// `object` is a report of s3-slam, or one of s3-refine's cameras.
void AddPinholeDoubt(const json& object, const std::string& whose,
                     std::vector<std::string>& doubts) {
  const json& pinhole = Member(object, "better_pinhole");
  if (!pinhole.is_array() || pinhole.size() != 4) return;
  std::array<double, 4> values{};
  for (size_t i = 0; i < values.size(); ++i) {
    const auto value = Number(pinhole[i]);
    if (!value) return;
    values[i] = *value;
  }
  doubts.push_back(fmt::format(
      "The calibration{} is in doubt: focal lengths of {:.1f}, {:.1f} px and a principal point of "
      "({:.1f}, {:.1f}) px would explain the images much better{}.",
      whose, values[0], values[1], values[2], values[3],
      ShareOfCost(object, "pinhole_cost_share")));
}

void AddShutterDoubt(const json& slam, std::vector<std::string>& doubts) {
  const json& shutter = Member(slam, "rolling_shutter");
  if (Member(shutter, "seen") != json(true) || Member(shutter, "compensated") == json(true)) return;
  doubts.emplace_back(
      "The images were taken by a rolling shutter, which bends the map: s3-slam corrects "
      "for it with --set rolling_shutter.mode=compensate.");
}

void AddRefinedCalibrationDoubts(const RunFolder& run, std::vector<std::string>& doubts) {
  const json* report = FindReport(run, "3_refine");
  if (report == nullptr) report = FindReport(run, "3_refine_plain");
  if (report == nullptr || !Member(*report, "cameras").is_array()) return;
  std::vector<std::string> found;
  for (const json& camera : Member(*report, "cameras")) {
    if (Member(camera, "refined") == json(true)) continue;
    const json& ids = Member(camera, "cameras");
    const auto id = ids.is_array() && !ids.empty() ? Count(ids[0]) : std::nullopt;
    const std::string whose = id ? fmt::format(" of camera {} in s3-refine", *id) : " in s3-refine";
    AddDistortionDoubt(camera, whose, found);
    AddPinholeDoubt(camera, whose, found);
  }
  if (found.size() > kMaxListed) {
    const size_t more = found.size() - kMaxListed;
    found.resize(kMaxListed);
    found.push_back(fmt::format("There are {} more doubts about calibrations.", more));
  }
  doubts.insert(doubts.end(), found.begin(), found.end());
}

void AddLeftOutDoubt(const json& slam, std::vector<std::string>& doubts) {
  const json& left_out = Member(slam, "images_left_out");
  if (!left_out.is_array() || left_out.empty()) return;
  std::string first = Text(left_out.front());
  if (!first.empty()) first = fmt::format("; the first is {}", first);
  doubts.push_back(fmt::format("Left out, as they cannot be used: {} image{}{}.", left_out.size(),
                               left_out.size() == 1 ? "" : "s", first));
}

/// Of the map shown, in the order of the sequence.
std::vector<FrameState> StatesOfMap(const FrameTrust& trust, bool only_keyframes) {
  std::vector<FrameState> states;
  if (trust.frames.empty()) return states;
  for (const FrameStretch& stretch : trust.stretches) {
    for (int i = stretch.first; i <= stretch.last; ++i) {
      const TrustedFrame& frame = trust.frames[static_cast<size_t>(i)];
      if (frame.map == 0 && (frame.is_keyframe || !only_keyframes)) states.push_back(stretch.state);
    }
  }
  return states;
}

}  // namespace

FrameTrust ReadFrameTrust(const RunFolder& run) {
  FrameTrust trust;
  const json* slam = FindReport(run, "1_slam");
  if (slam == nullptr) return trust;
  trust.stretches = ParseStretches(Member(*slam, "stretches"));
  trust.frames = ParseFrames(Member(*slam, "per_frame"), trust.NumFrames());
  return trust;
}

std::vector<FrameState> StatesOfTrajectory(const FrameTrust& trust, const Arm& arm) {
  for (const bool only_keyframes : {false, true}) {
    std::vector<FrameState> states = StatesOfMap(trust, only_keyframes);
    if (states.size() == arm.trajectory.size()) return states;
  }
  return {};
}

std::vector<std::string> DescribeDoubts(const RunFolder& run, const FrameTrust& trust) {
  std::vector<std::string> doubts;
  AddStretchDoubt(trust, FrameState::kWeak, "Little trusted", doubts);
  AddStretchDoubt(trust, FrameState::kLost, "Not localised", doubts);
  if (const json* slam = FindReport(run, "1_slam")) {
    AddMapDoubt(*slam, doubts);
    AddFocalDoubt(*slam, doubts);
    AddPinholeDoubt(*slam, "", doubts);
    AddShutterDoubt(*slam, doubts);
    AddLeftOutDoubt(*slam, doubts);
  }
  AddRefinedCalibrationDoubts(run, doubts);
  return doubts;
}

}  // namespace s3lam::report
