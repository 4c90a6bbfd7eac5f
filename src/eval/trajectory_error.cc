#include "s3lam/eval/trajectory_error.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

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

std::vector<PosePair> PairPoses(const Trajectory& estimate, const Trajectory& ground_truth,
                                double max_dt_s) {
  std::vector<PosePair> pairs;
  for (const auto& [i, j] : AssociateByTime(estimate, ground_truth, max_dt_s)) {
    pairs.push_back(
        {ground_truth[j].time_s, ground_truth[j].world_from_camera, estimate[i].world_from_camera});
  }
  return pairs;
}

Rigid3 TransformPose(const Similarity3& a_from_b, const Rigid3& b_from_camera) {
  return {(a_from_b.rotation * b_from_camera.rotation).normalized(),
          a_from_b * b_from_camera.translation};
}

void ApplyAlignment(const Similarity3& truth_from_estimate, std::vector<PosePair>& pairs) {
  for (PosePair& pair : pairs) pair.estimate = TransformPose(truth_from_estimate, pair.estimate);
}

/// RMSE of the positions after alignment; empty if that is not determined.
std::optional<double> AlignedRmse(std::vector<PosePair> pairs, TrajectoryAlignment alignment) {
  const auto truth_from_estimate = AlignPosePairs(pairs, alignment);
  if (!truth_from_estimate) return std::nullopt;
  ApplyAlignment(*truth_from_estimate, pairs);
  double sum = 0.0;
  for (const PosePair& pair : pairs) {
    sum += (pair.estimate.translation - pair.truth.translation).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(pairs.size()));
}

/// The same of an estimate that is the truth itself, `offset_s` later, at the times of `pairs`.
std::optional<double> AlignedRmseOfExactPoses(const Trajectory& ground_truth,
                                              std::vector<PosePair> pairs, double offset_s,
                                              TrajectoryAlignment alignment) {
  const PoseInterpolator truth(ground_truth);
  std::erase_if(pairs, [&](PosePair& pair) {
    const auto later = truth.At(pair.time_s + offset_s);
    if (later) pair.estimate = *later;
    return !later.has_value();
  });
  return AlignedRmse(std::move(pairs), alignment);
}

/// The offset that was given or asked for, and what `pairs`, which are without, give.
TimeOffsetEffect FindTimeOffset(const Trajectory& estimate, const Trajectory& ground_truth,
                                const TrajectoryErrorOptions& options,
                                std::vector<PosePair> pairs) {
  TimeOffsetEffect effect;
  effect.is_estimated = options.estimate_time_offset;
  effect.offset =
      options.estimate_time_offset
          ? EstimateTimeOffset(estimate, ground_truth, options.align, options.max_time_offset_s)
          : TimeOffset{options.time_offset_s, 0.0};
  effect.num_pairs_without = pairs.size();
  if (effect.offset) {
    effect.ate_rmse_of_exact =
        AlignedRmseOfExactPoses(ground_truth, pairs, effect.offset->offset_s, options.align);
  }
  if (effect.is_estimated) {
    effect.of_rotations =
        EstimateTimeOffsetOfRotations(estimate, ground_truth, options.max_time_offset_s);
  }
  effect.ate_rmse_without = AlignedRmse(std::move(pairs), options.align);
  return effect;
}

double RmsOverPoses(std::span<const PoseError> errors, double PoseError::*part) {
  double sum = 0.0;
  for (const PoseError& error : errors) sum += (error.*part) * (error.*part);
  return std::sqrt(sum / static_cast<double>(errors.size()));
}

Eigen::Vector3d RmsOverPoses(std::span<const PoseError> errors, Eigen::Vector3d PoseError::*part) {
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  for (const PoseError& error : errors) sum += (error.*part).array().square();
  return (sum / static_cast<double>(errors.size())).sqrt();
}

void MeasureAbsolute(TrajectoryErrors& errors) {
  std::vector<double> distances;
  std::vector<double> angles;
  for (const PoseError& pose : errors.poses) {
    distances.push_back(pose.difference.norm());
    angles.push_back(pose.rotation_deg);
  }
  errors.ate_rmse_per_axis = RmsOverPoses(errors.poses, &PoseError::difference);
  errors.ate_rmse_in_camera = RmsOverPoses(errors.poses, &PoseError::in_camera);
  errors.ate_rmse_along = RmsOverPoses(errors.poses, &PoseError::along);
  errors.ate_rmse_across = RmsOverPoses(errors.poses, &PoseError::across);
  errors.ate_translation = ComputeErrorStatistics(std::move(distances));
  errors.ate_rotation_deg = ComputeErrorStatistics(std::move(angles));
}

void MeasureRelative(std::span<const PosePair> pairs, TrajectoryErrors& errors) {
  const TrajectoryErrorOptions& options = errors.options;
  const RelativeErrors over_frames =
      RelativeErrorsOverFrames(pairs, static_cast<size_t>(options.rpe_delta_frames));
  errors.rpe_translation = over_frames.translation;
  errors.rpe_rotation_deg = over_frames.rotation_deg;
  errors.rpe_per_length = RelativeErrorsPerLength(pairs, options.rpe_delta_m);
  errors.segments = ComputeSegmentErrors(pairs, options.segment_lengths_m,
                                         static_cast<size_t>(options.segment_step_frames));
}

nlohmann::json AxesToJson(const Eigen::Vector3d& axes) { return {axes.x(), axes.y(), axes.z()}; }

}  // namespace

void TrajectoryErrorOptions::Visit(OptionVisitor& v) {
  v.Choice("align", align, kTrajectoryAlignmentNames,
           "what is aligned before measuring: a similarity, a rigid transform, nothing");
  v.Value("max_dt_s", max_dt_s, "poses farther apart in time are not associated [s]", 0.0);
  v.Value(
      "time_offset_s", time_offset_s,
      "how far the truth's clock is ahead: the truth at time + offset is what a pose is compared "
      "with, interpolated unless this is 0 [s]");
  v.Value("estimate_time_offset", estimate_time_offset,
          "estimate that offset together with the alignment");
  v.Value("max_time_offset_s", max_time_offset_s, "offsets up to this are tried [s]", 0.02, 10.0);
  v.Value("rpe_delta_frames", rpe_delta_frames,
          "distance between the two poses of a relative error [associated poses]", 1);
  v.Value("rpe_delta_m", rpe_delta_m,
          "way between the two poses of a relative error per length [unit of the truth]", 1e-9);
  v.Value("segment_lengths_m", segment_lengths_m,
          "lengths of the segments of KITTI's measure [unit of the truth]");
  v.Value("segment_step_frames", segment_step_frames,
          "a segment begins at every so-manieth pose [associated poses]", 1);
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
  S3LAM_CHECK(options.rpe_delta_frames > 0 && options.segment_step_frames > 0);
  TrajectoryErrors errors;
  errors.options = options;
  errors.num_estimate = estimate.size();
  errors.num_ground_truth = ground_truth.size();
  std::vector<PosePair> pairs = PairPoses(estimate, ground_truth, options.max_dt_s);
  if (options.estimate_time_offset || options.time_offset_s != 0.0) {
    errors.time_offset = FindTimeOffset(estimate, ground_truth, options, pairs);
    if (errors.time_offset->offset) {
      pairs = PairPosesAtOffset(estimate, ground_truth, errors.time_offset->offset->offset_s);
    }
  }
  const auto truth_from_estimate = AlignPosePairs(pairs, options.align);
  if (!truth_from_estimate) return std::nullopt;
  errors.num_pairs = pairs.size();
  errors.truth_from_estimate = *truth_from_estimate;
  ApplyAlignment(*truth_from_estimate, pairs);
  errors.poses = ComputePoseErrors(pairs);
  errors.path_length = errors.poses.back().path;
  MeasureAbsolute(errors);
  MeasureRelative(pairs, errors);
  return errors;
}

nlohmann::json ToJson(const Similarity3& a_from_b) {
  const Eigen::Quaterniond& q = a_from_b.rotation;
  return {{"scale", a_from_b.scale},
          {"rotation_wxyz", {q.w(), q.x(), q.y(), q.z()}},
          {"translation", AxesToJson(a_from_b.translation)}};
}

nlohmann::json ToJson(const TimeOffsetEffect& effect) {
  nlohmann::json json = {
      {"estimated", effect.is_estimated},
      {"seconds", nullptr},
      {"sigma_s", nullptr},
      {"of_rotations", nullptr},
      {"exact_poses_without", {{"ate_rmse", nullptr}}},
      {"without", {{"num_pairs", effect.num_pairs_without}, {"ate_rmse", nullptr}}}};
  if (effect.offset) json["seconds"] = effect.offset->offset_s;
  if (effect.offset && effect.is_estimated) json["sigma_s"] = effect.offset->sigma_s;
  if (effect.ate_rmse_without) json["without"]["ate_rmse"] = *effect.ate_rmse_without;
  if (effect.ate_rmse_of_exact) {
    json["exact_poses_without"]["ate_rmse"] = *effect.ate_rmse_of_exact;
  }
  if (effect.of_rotations) {
    json["of_rotations"] = {{"seconds", effect.of_rotations->offset_s},
                            {"sigma_s", effect.of_rotations->sigma_s}};
  }
  return json;
}

nlohmann::json ToJson(const TrajectoryErrors& errors) {
  return {{"align", TrajectoryAlignmentName(errors.options.align)},
          {"max_dt_s", errors.options.max_dt_s},
          {"num_estimate", errors.num_estimate},
          {"num_ground_truth", errors.num_ground_truth},
          {"num_pairs", errors.num_pairs},
          {"time_offset", errors.time_offset ? ToJson(*errors.time_offset) : nlohmann::json()},
          {"path_length", errors.path_length},
          {"truth_from_estimate", ToJson(errors.truth_from_estimate)},
          {"ate",
           {{"translation", ToJson(errors.ate_translation)},
            {"rotation_deg", ToJson(errors.ate_rotation_deg)},
            {"rmse_per_axis", AxesToJson(errors.ate_rmse_per_axis)},
            {"rmse_in_camera", AxesToJson(errors.ate_rmse_in_camera)},
            {"rmse_along", errors.ate_rmse_along},
            {"rmse_across", errors.ate_rmse_across}}},
          {"rpe",
           {{"delta_frames", errors.options.rpe_delta_frames},
            {"translation", ToJson(errors.rpe_translation)},
            {"rotation_deg", ToJson(errors.rpe_rotation_deg)}}},
          {"rpe_per_length",
           {{"delta", errors.options.rpe_delta_m},
            {"translation", ToJson(errors.rpe_per_length.translation)},
            {"rotation_deg", ToJson(errors.rpe_per_length.rotation_deg)}}},
          {"segments", ToJson(errors.segments)}};
}

std::string ToTable(const TimeOffsetEffect& effect) {
  std::string text = "time offset           cannot be told, none applied\n";
  if (effect.offset) {
    text = fmt::format("time offset           {:.4f} s", effect.offset->offset_s);
    text += effect.is_estimated ? fmt::format(" +- {:.4f} s, estimated", effect.offset->sigma_s)
                                : ", given";
    if (effect.ate_rmse_without) {
      text += fmt::format("; without it {} poses, ATE {:.6f}", effect.num_pairs_without,
                          *effect.ate_rmse_without);
    }
    if (effect.ate_rmse_of_exact) {
      text += fmt::format("; that of exact poses {:.6f}", *effect.ate_rmse_of_exact);
    }
    text += "\n";
  }
  if (effect.of_rotations) {
    text += fmt::format("  by rotations alone  {:.4f} s +- {:.4f} s\n",
                        effect.of_rotations->offset_s, effect.of_rotations->sigma_s);
  }
  return text;
}

std::string ToTable(const TrajectoryErrors& errors) {
  const bool interpolated = errors.time_offset && errors.time_offset->offset;
  std::string table = fmt::format(
      "poses                 {} estimated, {} of ground truth, {} {}\n"
      "path length           {:.6g}\n"
      "alignment             {}, scale {:.6g}\n",
      errors.num_estimate, errors.num_ground_truth, errors.num_pairs,
      interpolated ? "compared with interpolated ones"
                   : fmt::format("associated within {} s", errors.options.max_dt_s),
      errors.path_length, TrajectoryAlignmentName(errors.options.align),
      errors.truth_from_estimate.scale);
  if (errors.time_offset) table += ToTable(*errors.time_offset);
  table += "\n";
  table += TableHeader();
  table += TableRow("ATE", errors.ate_translation);
  table += TableRow("ATE rotation [deg]", errors.ate_rotation_deg);
  table += TableRow(fmt::format("RPE (delta {})", errors.options.rpe_delta_frames),
                    errors.rpe_translation);
  table += TableRow("RPE rotation [deg]", errors.rpe_rotation_deg);
  if (errors.rpe_per_length.translation.count > 0) {
    table += TableRow(fmt::format("RPE per unit (at {:g})", errors.options.rpe_delta_m),
                      errors.rpe_per_length.translation);
    table += TableRow("RPE rot. [deg/unit]", errors.rpe_per_length.rotation_deg);
  }
  const auto axes = [](std::string_view name, const Eigen::Vector3d& v) {
    return fmt::format("{:<22} {:>11.6f} {:>11.6f} {:>11.6f}\n", name, v.x(), v.y(), v.z());
  };
  table += "\n";
  table += axes("RMSE in x, y, z", errors.ate_rmse_per_axis);
  table += axes("in the camera's axes", errors.ate_rmse_in_camera);
  table += fmt::format("{:<22} {:>11.6f} {:>11.6f}\n", "along, across the way",
                       errors.ate_rmse_along, errors.ate_rmse_across);
  if (errors.segments.by_length.empty()) return table;
  table += "\n";
  table += ToTable(errors.segments);
  return table;
}

}  // namespace s3lam
