#include "s3lam/eval/trajectory_error.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "s3lam/base/error.h"
#include "s3lam/geometry/alignment.h"

namespace s3lam {
namespace {

constexpr std::array<std::string_view, 3> kAlignmentNames = {"sim3", "se3", "none"};
constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;
/// Fewer say nothing, and do not determine an alignment.
constexpr size_t kMinPairs = 3;

/// Index of the pose nearest in time.
size_t Nearest(const Trajectory& trajectory, double time_s) {
  const auto after =
      std::lower_bound(trajectory.begin(), trajectory.end(), time_s,
                       [](const TimedPose& pose, double time) { return pose.time_s < time; });
  if (after == trajectory.begin()) return 0;
  const auto before = after - 1;
  const bool take_after =
      after != trajectory.end() && after->time_s - time_s < time_s - before->time_s;
  return static_cast<size_t>((take_after ? after : before) - trajectory.begin());
}

struct PosePair {
  double time_s = 0.0;
  Rigid3 truth;     // world_from_camera
  Rigid3 estimate;  // world_from_camera, in the truth's world once aligned
};

std::vector<PosePair> PairPoses(const Trajectory& estimate, const Trajectory& ground_truth,
                                double max_dt_s) {
  std::vector<PosePair> pairs;
  for (const auto& [i, j] : AssociateByTime(estimate, ground_truth, max_dt_s)) {
    pairs.push_back(
        {ground_truth[j].time_s, ground_truth[j].world_from_camera, estimate[i].world_from_camera});
  }
  return pairs;
}

std::optional<Similarity3> Align(const std::vector<PosePair>& pairs,
                                 TrajectoryAlignment alignment) {
  if (alignment == TrajectoryAlignment::kNone) return Similarity3();
  std::vector<Eigen::Vector3d> truth;
  std::vector<Eigen::Vector3d> estimate;
  for (const PosePair& pair : pairs) {
    truth.push_back(pair.truth.translation);
    estimate.push_back(pair.estimate.translation);
  }
  return AlignPoints(truth, estimate, alignment == TrajectoryAlignment::kSim3);
}

Rigid3 TransformPose(const Similarity3& a_from_b, const Rigid3& b_from_camera) {
  return {(a_from_b.rotation * b_from_camera.rotation).normalized(),
          a_from_b * b_from_camera.translation};
}

void MeasureAbsolute(const std::vector<PosePair>& pairs, TrajectoryErrors& errors) {
  std::vector<double> distances;
  std::vector<double> angles;
  Eigen::Array3d squares = Eigen::Array3d::Zero();
  for (const PosePair& pair : pairs) {
    const Eigen::Vector3d difference = pair.estimate.translation - pair.truth.translation;
    distances.push_back(difference.norm());
    angles.push_back(kDegreesPerRadian *
                     RotationAngle(pair.truth.rotation, pair.estimate.rotation));
    squares += difference.array().square();
    errors.ate_by_time.emplace_back(pair.time_s, distances.back());
  }
  errors.ate_rmse_per_axis = (squares / static_cast<double>(pairs.size())).sqrt();
  errors.ate_translation = ComputeErrorStatistics(std::move(distances));
  errors.ate_rotation_deg = ComputeErrorStatistics(std::move(angles));
}

void MeasureRelative(const std::vector<PosePair>& pairs, size_t delta, TrajectoryErrors& errors) {
  std::vector<double> distances;
  std::vector<double> angles;
  for (size_t i = 0; i + delta < pairs.size(); ++i) {
    const Rigid3 truth = pairs[i].truth.Inverse() * pairs[i + delta].truth;
    const Rigid3 estimate = pairs[i].estimate.Inverse() * pairs[i + delta].estimate;
    const Rigid3 error = truth.Inverse() * estimate;
    distances.push_back(error.translation.norm());
    angles.push_back(kDegreesPerRadian * RotationVectorFromQuaternion(error.rotation).norm());
  }
  errors.rpe_translation = ComputeErrorStatistics(std::move(distances));
  errors.rpe_rotation_deg = ComputeErrorStatistics(std::move(angles));
}

nlohmann::json StatisticsToJson(const ErrorStatistics& statistics) {
  return {{"count", statistics.count},   {"rmse", statistics.rmse}, {"mean", statistics.mean},
          {"median", statistics.median}, {"std", statistics.std},   {"min", statistics.min},
          {"max", statistics.max}};
}

std::string TableRow(std::string_view name, const ErrorStatistics& statistics) {
  return fmt::format("{:<22}{:>12.6f}{:>12.6f}{:>12.6f}{:>12.6f}{:>12.6f}\n", name, statistics.rmse,
                     statistics.mean, statistics.median, statistics.min, statistics.max);
}

}  // namespace

std::optional<TrajectoryAlignment> TrajectoryAlignmentFromName(std::string_view name) {
  for (size_t i = 0; i < kAlignmentNames.size(); ++i) {
    if (kAlignmentNames[i] == name) return static_cast<TrajectoryAlignment>(i);
  }
  return std::nullopt;
}

std::string_view TrajectoryAlignmentName(TrajectoryAlignment alignment) {
  return kAlignmentNames.at(static_cast<size_t>(alignment));
}

void TrajectoryErrorOptions::Visit(OptionVisitor& v) {
  v.Choice("align", align, kAlignmentNames,
           "what is aligned before measuring: a similarity, a rigid transform, nothing");
  v.Value("max_dt_s", max_dt_s, "poses farther apart in time are not associated [s]", 0.0);
  v.Value("rpe_delta_frames", rpe_delta_frames,
          "distance between the two poses of a relative error [associated poses]", 1);
}

ErrorStatistics ComputeErrorStatistics(std::vector<double> errors) {
  ErrorStatistics statistics;
  if (errors.empty()) return statistics;
  std::sort(errors.begin(), errors.end());
  const auto count = static_cast<double>(errors.size());
  double sum = 0.0;
  double sum_squared = 0.0;
  for (const double error : errors) {
    sum += error;
    sum_squared += error * error;
  }
  statistics.count = errors.size();
  statistics.mean = sum / count;
  statistics.rmse = std::sqrt(sum_squared / count);
  double squared_deviations = 0.0;
  for (const double error : errors) {
    squared_deviations += (error - statistics.mean) * (error - statistics.mean);
  }
  statistics.std = std::sqrt(squared_deviations / count);
  const size_t middle = errors.size() / 2;
  statistics.median =
      errors.size() % 2 == 1 ? errors[middle] : 0.5 * (errors[middle - 1] + errors[middle]);
  statistics.min = errors.front();
  statistics.max = errors.back();
  return statistics;
}

std::vector<std::pair<size_t, size_t>> AssociateByTime(const Trajectory& a, const Trajectory& b,
                                                       double max_dt_s) {
  std::vector<std::pair<size_t, size_t>> pairs;
  if (a.empty() || b.empty()) return pairs;
  for (size_t i = 0; i < a.size(); ++i) {
    const size_t j = Nearest(b, a[i].time_s);
    const bool close = std::abs(a[i].time_s - b[j].time_s) <= max_dt_s;
    if (close && Nearest(a, b[j].time_s) == i) pairs.emplace_back(i, j);
  }
  return pairs;
}

std::optional<TrajectoryErrors> CompareTrajectories(const Trajectory& estimate,
                                                    const Trajectory& ground_truth,
                                                    const TrajectoryErrorOptions& options) {
  S3LAM_CHECK(options.rpe_delta_frames > 0);
  std::vector<PosePair> pairs = PairPoses(estimate, ground_truth, options.max_dt_s);
  if (pairs.size() < kMinPairs) return std::nullopt;
  const auto truth_from_estimate = Align(pairs, options.align);
  if (!truth_from_estimate) return std::nullopt;

  TrajectoryErrors errors;
  errors.options = options;
  errors.num_estimate = estimate.size();
  errors.num_ground_truth = ground_truth.size();
  errors.num_pairs = pairs.size();
  errors.truth_from_estimate = *truth_from_estimate;
  for (PosePair& pair : pairs) pair.estimate = TransformPose(*truth_from_estimate, pair.estimate);
  for (size_t i = 1; i < pairs.size(); ++i) {
    errors.path_length += (pairs[i].truth.translation - pairs[i - 1].truth.translation).norm();
  }
  MeasureAbsolute(pairs, errors);
  MeasureRelative(pairs, static_cast<size_t>(options.rpe_delta_frames), errors);
  return errors;
}

nlohmann::json ToJson(const TrajectoryErrors& errors) {
  const Similarity3& s = errors.truth_from_estimate;
  const Eigen::Vector3d& axes = errors.ate_rmse_per_axis;
  return {{"align", TrajectoryAlignmentName(errors.options.align)},
          {"max_dt_s", errors.options.max_dt_s},
          {"num_estimate", errors.num_estimate},
          {"num_ground_truth", errors.num_ground_truth},
          {"num_pairs", errors.num_pairs},
          {"path_length", errors.path_length},
          {"truth_from_estimate",
           {{"scale", s.scale},
            {"rotation_wxyz", {s.rotation.w(), s.rotation.x(), s.rotation.y(), s.rotation.z()}},
            {"translation", {s.translation.x(), s.translation.y(), s.translation.z()}}}},
          {"ate",
           {{"translation", StatisticsToJson(errors.ate_translation)},
            {"rotation_deg", StatisticsToJson(errors.ate_rotation_deg)},
            {"rmse_per_axis", {axes.x(), axes.y(), axes.z()}}}},
          {"rpe",
           {{"delta_frames", errors.options.rpe_delta_frames},
            {"translation", StatisticsToJson(errors.rpe_translation)},
            {"rotation_deg", StatisticsToJson(errors.rpe_rotation_deg)}}}};
}

std::string ToTable(const TrajectoryErrors& errors) {
  const Eigen::Vector3d& axes = errors.ate_rmse_per_axis;
  std::string table = fmt::format(
      "poses                 {} estimated, {} of ground truth, {} associated within {} s\n"
      "path length           {:.6g}\n"
      "alignment             {}, scale {:.6g}\n\n"
      "{:<22}{:>12}{:>12}{:>12}{:>12}{:>12}\n",
      errors.num_estimate, errors.num_ground_truth, errors.num_pairs, errors.options.max_dt_s,
      errors.path_length, TrajectoryAlignmentName(errors.options.align),
      errors.truth_from_estimate.scale, "", "rmse", "mean", "median", "min", "max");
  table += TableRow("ATE", errors.ate_translation);
  table += TableRow("ATE rotation [deg]", errors.ate_rotation_deg);
  table += TableRow(fmt::format("RPE (delta {})", errors.options.rpe_delta_frames),
                    errors.rpe_translation);
  table += TableRow("RPE rotation [deg]", errors.rpe_rotation_deg);
  table += fmt::format("ATE x, y, z           {:>12.6f}{:>12.6f}{:>12.6f}\n", axes.x(), axes.y(),
                       axes.z());
  return table;
}

}  // namespace s3lam
