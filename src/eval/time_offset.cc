#include "s3lam/eval/time_offset.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "s3lam/base/statistics.h"

namespace s3lam {
namespace {

constexpr double kBridgedIntervals = 3.0;
constexpr double kScanStepS = 0.01;
constexpr double kPrecisionS = 1e-6;
constexpr size_t kNumBlocks = 10;
/// Share of the squared velocities that no alignment explains, at least.
constexpr double kMinUnexplained = 1e-6;

double MedianInterval(const Trajectory& trajectory) {
  std::vector<double> intervals;
  for (size_t i = 1; i < trajectory.size(); ++i) {
    intervals.push_back(trajectory[i].time_s - trajectory[i - 1].time_s);
  }
  return intervals.empty() ? 0.0 : Median(std::move(intervals));
}

/// Offsets are tried from minus to plus this many steps.
int ScanSteps(double max_offset_s) {
  return static_cast<int>(std::floor(max_offset_s / kScanStepS + 1e-9));
}

/// The distances as a function of the offset, over the poses that the truth covers at every offset
/// that is tried: with others at each, offsets would not compare.
class OffsetProblem {
 public:
  OffsetProblem(const Trajectory& estimate, const Trajectory& ground_truth,
                TrajectoryAlignment alignment, double max_offset_s)
      : truth_(ground_truth), alignment_(alignment) {
    for (const TimedPose& pose : estimate) {
      bool is_covered = true;
      const int steps = ScanSteps(max_offset_s);
      for (int k = -steps; k <= steps && is_covered; ++k) {
        is_covered = truth_.At(pose.time_s + k * kScanStepS).has_value();
      }
      if (is_covered) estimate_.push_back(pose);
    }
  }

  /// Sum of the squared distances after alignment.
  [[nodiscard]] double Cost(double offset_s) const {
    std::vector<PosePair> pairs = PairsAt(offset_s);
    const auto truth_from_estimate = AlignPosePairs(pairs, alignment_);
    if (!truth_from_estimate) return std::numeric_limits<double>::infinity();
    double cost = 0.0;
    for (const PosePair& pair : pairs) {
      cost +=
          (pair.truth.translation - *truth_from_estimate * pair.estimate.translation).squaredNorm();
    }
    return cost;
  }

  /// Standard error at the minimum; empty if the motion does not determine the offset.
  [[nodiscard]] std::optional<double> Sigma(double offset_s) const;

 private:
  [[nodiscard]] std::vector<PosePair> PairsAt(double offset_s) const {
    std::vector<PosePair> pairs;
    for (const TimedPose& pose : estimate_) {
      if (const auto truth = truth_.At(pose.time_s + offset_s)) {
        pairs.push_back({pose.time_s, truth->world_from_camera, pose.world_from_camera});
      }
    }
    return pairs;
  }

  PoseInterpolator truth_;
  TrajectoryAlignment alignment_;
  Trajectory estimate_;
};

using AlignmentJacobian = Eigen::Matrix<double, 3, 7>;

/// How an aligned position x changes with the alignment: translation, rotation, scale.
AlignmentJacobian JacobianOf(const Eigen::Vector3d& x, TrajectoryAlignment alignment) {
  AlignmentJacobian jacobian = AlignmentJacobian::Zero();
  if (alignment == TrajectoryAlignment::kNone) return jacobian;
  jacobian.leftCols<3>().setIdentity();
  jacobian.middleCols<3>(3) = -CrossMatrix(x);
  if (alignment == TrajectoryAlignment::kSim3) jacobian.col(6) = x;
  return jacobian;
}

/// What no alignment explains of the velocities; the rest says nothing of the offset.
std::vector<Eigen::Vector3d> UnexplainedVelocities(std::span<const Eigen::Vector3d> aligned,
                                                   std::span<const Eigen::Vector3d> velocities,
                                                   TrajectoryAlignment alignment) {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& x : aligned) center += x / static_cast<double>(aligned.size());
  Eigen::Matrix<double, 7, 7> normal = Eigen::Matrix<double, 7, 7>::Zero();
  Eigen::Matrix<double, 7, 1> right = Eigen::Matrix<double, 7, 1>::Zero();
  for (size_t i = 0; i < aligned.size(); ++i) {
    const AlignmentJacobian jacobian = JacobianOf(aligned[i] - center, alignment);
    normal += jacobian.transpose() * jacobian;
    right += jacobian.transpose() * velocities[i];
  }
  const Eigen::Matrix<double, 7, 1> explained = normal.ldlt().solve(right);
  std::vector<Eigen::Vector3d> rest;
  for (size_t i = 0; i < aligned.size(); ++i) {
    rest.emplace_back(velocities[i] - JacobianOf(aligned[i] - center, alignment) * explained);
  }
  return rest;
}

std::optional<double> OffsetProblem::Sigma(double offset_s) const {
  const std::vector<PosePair> pairs = PairsAt(offset_s);
  const auto truth_from_estimate = AlignPosePairs(pairs, alignment_);
  if (!truth_from_estimate) return std::nullopt;
  std::vector<Eigen::Vector3d> aligned;
  std::vector<Eigen::Vector3d> velocities;
  double squared_velocities = 0.0;
  for (const PosePair& pair : pairs) {
    aligned.emplace_back(*truth_from_estimate * pair.estimate.translation);
    velocities.push_back(truth_.At(pair.time_s + offset_s)->velocity);
    squared_velocities += velocities.back().squaredNorm();
  }
  const auto rest = UnexplainedVelocities(aligned, velocities, alignment_);
  double curvature = 0.0;
  std::array<double, kNumBlocks> gradients{};
  for (size_t i = 0; i < pairs.size(); ++i) {
    curvature += rest[i].squaredNorm();
    gradients[i * kNumBlocks / pairs.size()] +=
        rest[i].dot(pairs[i].truth.translation - aligned[i]);
  }
  if (!(curvature > kMinUnexplained * squared_velocities)) return std::nullopt;
  double sum = 0.0;
  for (const double gradient : gradients) sum += gradient * gradient;
  constexpr double kFewBlocks = kNumBlocks / (kNumBlocks - 1.0);
  return std::sqrt(kFewBlocks * sum) / curvature;
}

/// The minimum of a function with one in [low, high], by golden sections.
template <typename Function>
double Minimise(const Function& function, double low, double high) {
  constexpr double kGolden = 0.6180339887498949;
  double a = high - kGolden * (high - low);
  double b = low + kGolden * (high - low);
  double at_a = function(a);
  double at_b = function(b);
  while (high - low > kPrecisionS) {
    if (at_a < at_b) {
      high = b;
      b = a;
      at_b = at_a;
      a = high - kGolden * (high - low);
      at_a = function(a);
    } else {
      low = a;
      a = b;
      at_a = at_b;
      b = low + kGolden * (high - low);
      at_b = function(b);
    }
  }
  return 0.5 * (low + high);
}

}  // namespace

PoseInterpolator::PoseInterpolator(const Trajectory& trajectory)
    : trajectory_(trajectory), max_gap_s_(kBridgedIntervals * MedianInterval(trajectory)) {}

bool PoseInterpolator::IsBridged(size_t i) const {
  return trajectory_[i + 1].time_s - trajectory_[i].time_s <= max_gap_s_;
}

Eigen::Vector3d PoseInterpolator::SlopeAt(size_t i) const {
  const size_t before = i > 0 && IsBridged(i - 1) ? i - 1 : i;
  const size_t after = i + 1 < trajectory_.size() && IsBridged(i) ? i + 1 : i;
  return (trajectory_[after].world_from_camera.translation -
          trajectory_[before].world_from_camera.translation) /
         (trajectory_[after].time_s - trajectory_[before].time_s);
}

std::optional<PoseInterpolator::Sample> PoseInterpolator::At(double time_s) const {
  const auto after =
      std::lower_bound(trajectory_.begin(), trajectory_.end(), time_s,
                       [](const TimedPose& pose, double time) { return pose.time_s < time; });
  if (trajectory_.size() < 2 || after == trajectory_.end()) return std::nullopt;
  const auto last = static_cast<size_t>(after - trajectory_.begin());
  size_t i = last - 1;
  if (last == 0 || !IsBridged(last - 1)) {  // Still, a pose itself is known.
    if (after->time_s > time_s || last + 1 == trajectory_.size()) return std::nullopt;
    i = last;
    if (!IsBridged(i)) return std::nullopt;
  }
  const TimedPose& from = trajectory_[i];
  const TimedPose& to = trajectory_[i + 1];
  const double dt = to.time_s - from.time_s;
  const double s = (time_s - from.time_s) / dt;
  const Eigen::Vector3d step =
      to.world_from_camera.translation - from.world_from_camera.translation;
  const Eigen::Vector3d slope_from = dt * SlopeAt(i);
  const Eigen::Vector3d slope_to = dt * SlopeAt(i + 1);
  // p(s) = p0 + m0 s + (3 d - 2 m0 - m1) s^2 + (m0 + m1 - 2 d) s^3 with d = p1 - p0.
  const Eigen::Vector3d second = 3.0 * step - 2.0 * slope_from - slope_to;
  const Eigen::Vector3d third = slope_from + slope_to - 2.0 * step;
  Sample sample;
  sample.world_from_camera.translation =
      from.world_from_camera.translation + s * (slope_from + s * (second + s * third));
  sample.world_from_camera.rotation =
      from.world_from_camera.rotation.slerp(s, to.world_from_camera.rotation).normalized();
  sample.velocity = (slope_from + s * (2.0 * second + 3.0 * s * third)) / dt;
  return sample;
}

std::vector<PosePair> PairPosesAtOffset(const Trajectory& estimate, const Trajectory& ground_truth,
                                        double offset_s) {
  const PoseInterpolator truth(ground_truth);
  std::vector<PosePair> pairs;
  for (const TimedPose& pose : estimate) {
    const double time_s = pose.time_s + offset_s;
    if (const auto sample = truth.At(time_s)) {
      pairs.push_back({time_s, sample->world_from_camera, pose.world_from_camera});
    }
  }
  return pairs;
}

std::optional<TimeOffset> EstimateTimeOffset(const Trajectory& estimate,
                                             const Trajectory& ground_truth,
                                             TrajectoryAlignment alignment, double max_offset_s) {
  const OffsetProblem problem(estimate, ground_truth, alignment, max_offset_s);
  const int steps = ScanSteps(max_offset_s);
  int best = 0;
  double best_cost = std::numeric_limits<double>::infinity();
  for (int k = -steps; k <= steps; ++k) {
    const double cost = problem.Cost(k * kScanStepS);
    if (cost >= best_cost) continue;
    best = k;
    best_cost = cost;
  }
  if (!std::isfinite(best_cost) || std::abs(best) == steps) return std::nullopt;
  TimeOffset offset;
  offset.offset_s = Minimise([&](double at) { return problem.Cost(at); }, (best - 1) * kScanStepS,
                             (best + 1) * kScanStepS);
  const auto sigma = problem.Sigma(offset.offset_s);
  if (!sigma || *sigma > max_offset_s) return std::nullopt;
  offset.sigma_s = *sigma;
  return offset;
}

}  // namespace s3lam
