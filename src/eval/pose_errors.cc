#include "s3lam/eval/pose_errors.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numbers>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;

/// Way of the truth from the first pose to each.
std::vector<double> TruePath(std::span<const PosePair> pairs) {
  std::vector<double> path(pairs.size(), 0.0);
  for (size_t i = 1; i < pairs.size(); ++i) {
    path[i] = path[i - 1] + (pairs[i].truth.translation - pairs[i - 1].truth.translation).norm();
  }
  return path;
}

struct RelativeError {
  double translation = 0.0;
  double rotation_deg = 0.0;
};

RelativeError Compare(const PosePair& from, const PosePair& to) {
  const Rigid3 truth = from.truth.Inverse() * to.truth;
  const Rigid3 estimate = from.estimate.Inverse() * to.estimate;
  const Rigid3 error = truth.Inverse() * estimate;
  return {error.translation.norm(),
          kDegreesPerRadian * RotationVectorFromQuaternion(error.rotation).norm()};
}

RelativeErrors Summarize(const std::vector<RelativeError>& errors) {
  std::vector<double> translations;
  std::vector<double> rotations;
  for (const RelativeError& error : errors) {
    translations.push_back(error.translation);
    rotations.push_back(error.rotation_deg);
  }
  return {ComputeErrorStatistics(std::move(translations)),
          ComputeErrorStatistics(std::move(rotations))};
}

Eigen::Vector3d TravelDirection(std::span<const PosePair> pairs, size_t i) {
  const PosePair& before = pairs[i == 0 ? 0 : i - 1];
  const PosePair& after = pairs[std::min(i + 1, pairs.size() - 1)];
  const Eigen::Vector3d step = after.truth.translation - before.truth.translation;
  const double length = step.norm();
  return length > 0.0 ? Eigen::Vector3d(step / length) : Eigen::Vector3d::Zero();
}

SegmentErrors Mean(double length, const std::vector<RelativeError>& per_length) {
  SegmentErrors mean{length, per_length.size(), 0.0, 0.0};
  if (per_length.empty()) return mean;
  for (const RelativeError& error : per_length) {
    mean.translation_percent += 100.0 * error.translation;
    mean.rotation_deg_per_length += error.rotation_deg;
  }
  mean.translation_percent /= static_cast<double>(mean.count);
  mean.rotation_deg_per_length /= static_cast<double>(mean.count);
  return mean;
}

/// As RFC 4180 has it: quotes within are doubled.
std::string Quoted(const std::string& name) {
  std::string quoted = "\"";
  for (const char c : name) quoted += c == '"' ? std::string(2, c) : std::string(1, c);
  return quoted + "\"";
}

nlohmann::json SegmentToJson(const SegmentErrors& errors) {
  return {{"length", errors.length},
          {"count", errors.count},
          {"translation_percent", errors.translation_percent},
          {"rotation_deg_per_length", errors.rotation_deg_per_length}};
}

}  // namespace

std::vector<PoseError> ComputePoseErrors(std::span<const PosePair> pairs) {
  const std::vector<double> path = TruePath(pairs);
  std::vector<PoseError> errors;
  for (size_t i = 0; i < pairs.size(); ++i) {
    const PosePair& pair = pairs[i];
    PoseError error;
    error.time_s = pair.time_s;
    error.path = path[i];
    error.difference = pair.estimate.translation - pair.truth.translation;
    error.in_camera = pair.truth.rotation.conjugate() * error.difference;
    const Eigen::Vector3d direction = TravelDirection(pairs, i);
    error.along = direction.dot(error.difference);
    error.across = (error.difference - error.along * direction).norm();
    error.rotation_deg =
        kDegreesPerRadian * RotationAngle(pair.truth.rotation, pair.estimate.rotation);
    errors.push_back(error);
  }
  return errors;
}

RelativeErrors RelativeErrorsOverFrames(std::span<const PosePair> pairs, size_t delta) {
  S3LAM_CHECK(delta > 0);
  std::vector<RelativeError> errors;
  for (size_t i = 0; i + delta < pairs.size(); ++i) {
    errors.push_back(Compare(pairs[i], pairs[i + delta]));
  }
  return Summarize(errors);
}

RelativeErrors RelativeErrorsPerLength(std::span<const PosePair> pairs, double delta) {
  S3LAM_CHECK(delta > 0.0);
  const std::vector<double> path = TruePath(pairs);
  std::vector<RelativeError> errors;
  for (size_t i = 0; i < pairs.size(); ++i) {
    const auto end = std::lower_bound(path.begin(), path.end(), path[i] + delta);
    if (end == path.end()) break;
    RelativeError error = Compare(pairs[i], pairs[static_cast<size_t>(end - path.begin())]);
    error.translation /= *end - path[i];
    error.rotation_deg /= *end - path[i];
    errors.push_back(error);
  }
  return Summarize(errors);
}

SegmentErrorTable ComputeSegmentErrors(std::span<const PosePair> pairs,
                                       std::span<const double> lengths, size_t step) {
  S3LAM_CHECK(step > 0);
  const std::vector<double> path = TruePath(pairs);
  SegmentErrorTable table;
  std::vector<RelativeError> of_all;
  for (const double length : lengths) {
    std::vector<RelativeError> errors;
    for (size_t i = 0; i < pairs.size(); i += step) {
      const auto end = std::upper_bound(path.begin(), path.end(), path[i] + length);
      if (end == path.end()) break;
      RelativeError error = Compare(pairs[i], pairs[static_cast<size_t>(end - path.begin())]);
      error.translation /= length;
      error.rotation_deg /= length;
      errors.push_back(error);
    }
    of_all.insert(of_all.end(), errors.begin(), errors.end());
    if (!errors.empty()) table.by_length.push_back(Mean(length, errors));
  }
  table.all = Mean(0.0, of_all);
  return table;
}

std::string ToCsv(std::span<const PoseError> errors, std::span<const std::string> names) {
  S3LAM_CHECK(names.empty() || names.size() == errors.size());
  std::string csv = names.empty() ? "" : "name,";
  csv += "time_s,path,error,x,y,z,camera_x,camera_y,camera_z,along,across,rotation_deg\n";
  for (size_t i = 0; i < errors.size(); ++i) {
    const PoseError& e = errors[i];
    if (!names.empty()) csv += Quoted(names[i]) + ",";
    csv +=
        fmt::format("{},{},{},{},{},{},{},{},{},{},{},{}\n", e.time_s, e.path, e.difference.norm(),
                    e.difference.x(), e.difference.y(), e.difference.z(), e.in_camera.x(),
                    e.in_camera.y(), e.in_camera.z(), e.along, e.across, e.rotation_deg);
  }
  return csv;
}

nlohmann::json ToJson(std::span<const PoseError> errors, std::span<const std::string> names) {
  S3LAM_CHECK(names.empty() || names.size() == errors.size());
  nlohmann::json list = nlohmann::json::array();
  for (size_t i = 0; i < errors.size(); ++i) {
    const PoseError& e = errors[i];
    const Eigen::Vector3d& d = e.difference;
    const Eigen::Vector3d& c = e.in_camera;
    list.push_back({{"time_s", e.time_s},
                    {"path", e.path},
                    {"error", d.norm()},
                    {"xyz", {d.x(), d.y(), d.z()}},
                    {"camera_xyz", {c.x(), c.y(), c.z()}},
                    {"along", e.along},
                    {"across", e.across},
                    {"rotation_deg", e.rotation_deg}});
    if (!names.empty()) list.back()["name"] = names[i];
  }
  return list;
}

nlohmann::json ToJson(const SegmentErrorTable& table) {
  nlohmann::json list = nlohmann::json::array();
  for (const SegmentErrors& errors : table.by_length) list.push_back(SegmentToJson(errors));
  return {{"by_length", list}, {"all", SegmentToJson(table.all)}};
}

std::string ToTable(const SegmentErrorTable& table) {
  std::string text =
      fmt::format("{:<22}{:>12}{:>12}{:>12}\n", "segments of length", "count", "[%]", "[deg/unit]");
  const auto row = [](const std::string& name, const SegmentErrors& errors) {
    return fmt::format("{:<22}{:>12}{:>12.4f}{:>12.6f}\n", name, errors.count,
                       errors.translation_percent, errors.rotation_deg_per_length);
  };
  for (const SegmentErrors& errors : table.by_length) {
    text += row(fmt::format("{:g}", errors.length), errors);
  }
  return text + row("all", table.all);
}

}  // namespace s3lam
