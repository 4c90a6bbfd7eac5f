#include "s3lam/eval/time_offset.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "s3lam/base/statistics.h"
#include "s3lam/geometry/alignment.h"

namespace s3lam {
namespace {

constexpr double kBridgedIntervals = 3.0;
constexpr double kScanStepS = 0.01;
constexpr double kPrecisionS = 1e-6;
constexpr double kDerivativeStepS = 1e-3;
constexpr size_t kNumBlocks = 10;
/// Share of the squared velocities that no alignment explains, at least.
constexpr double kMinUnexplained = 1e-6;

double MedianInterval(const Trajectory& trajectory) {
  std::vector<double> times_s;
  for (const TimedPose& pose : trajectory) times_s.push_back(pose.time_s);
  return MedianStep(times_s);
}

/// Offsets are tried from minus to plus this many steps.
int ScanSteps(double max_offset_s) {
  return static_cast<int>(std::floor(max_offset_s / kScanStepS + 1e-9));
}

using Vectors = std::vector<Eigen::Vector3d>;

/// What is compared at an offset: vectors of the truth there, and those of the estimate aligned
/// with them. Of the same number and order at every offset.
struct AlignedVectors {
  Vectors truth;
  Vectors estimate;
};
using VectorsAtOffset = std::function<std::optional<AlignedVectors>(double offset_s)>;

/// Those poses that the truth covers at every offset: with others at each, they would not compare.
Trajectory CoveredPoses(const Trajectory& estimate, const PoseInterpolator& truth,
                        double max_offset_s) {
  const double reach_s = max_offset_s + kDerivativeStepS;
  Trajectory covered;
  for (const TimedPose& pose : estimate) {
    if (truth.Covers(pose.time_s - reach_s, pose.time_s + reach_s)) covered.push_back(pose);
  }
  return covered;
}

double SumOfSquaredDistances(const AlignedVectors& vectors) {
  double sum = 0.0;
  for (size_t i = 0; i < vectors.truth.size(); ++i) {
    sum += (vectors.truth[i] - vectors.estimate[i]).squaredNorm();
  }
  return sum;
}

/// Standard error of the offset with the smallest distances; empty if the vectors do not determine
/// it.
std::optional<double> SigmaOfOffset(const VectorsAtOffset& vectors_at, double offset_s) {
  const auto at = vectors_at(offset_s);
  const auto before = vectors_at(offset_s - kDerivativeStepS);
  const auto after = vectors_at(offset_s + kDerivativeStepS);
  if (!at || !before || !after) return std::nullopt;
  const size_t size = at->truth.size();
  double squared_derivatives = 0.0;  // Of the truth; an alignment may explain them.
  double curvature = 0.0;            // Of what no alignment explains; the rest tells no offset.
  std::array<double, kNumBlocks> gradients{};
  for (size_t i = 0; i < size; ++i) {
    const Eigen::Vector3d change = after->truth[i] - before->truth[i];
    const Eigen::Vector3d explained = after->estimate[i] - before->estimate[i];
    const Eigen::Vector3d rest = (change - explained) / (2.0 * kDerivativeStepS);
    squared_derivatives += (change / (2.0 * kDerivativeStepS)).squaredNorm();
    curvature += rest.squaredNorm();
    gradients[i * kNumBlocks / size] += rest.dot(at->truth[i] - at->estimate[i]);
  }
  if (!(curvature > kMinUnexplained * squared_derivatives)) return std::nullopt;
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

/// In the axes of the camera [rad/s].
Eigen::Vector3d AngularVelocity(const Rigid3& world_from_camera, const Rigid3& world_from_next,
                                double interval_s) {
  return RotationVectorFromQuaternion(world_from_camera.rotation.conjugate() *
                                      world_from_next.rotation) /
         interval_s;
}

/// The rotation that brings vectors nearest to others; empty if it is not determined.
std::optional<Eigen::Quaterniond> AlignDirections(Vectors in_a, Vectors in_b) {
  const size_t size = in_a.size();
  for (size_t i = 0; i < size; ++i) {  // With these, nothing is to be shifted.
    in_a.emplace_back(-in_a[i]);
    in_b.emplace_back(-in_b[i]);
  }
  const auto a_from_b = AlignPoints(in_a, in_b, false);
  if (!a_from_b) return std::nullopt;
  return a_from_b->rotation;
}

/// The offset with the smallest distances.
std::optional<TimeOffset> FindOffset(const VectorsAtOffset& vectors_at, double max_offset_s) {
  const auto cost = [&](double offset_s) {
    const auto vectors = vectors_at(offset_s);
    return vectors ? SumOfSquaredDistances(*vectors) : std::numeric_limits<double>::infinity();
  };
  const int steps = ScanSteps(max_offset_s);
  int best = 0;
  double best_cost = std::numeric_limits<double>::infinity();
  for (int k = -steps; k <= steps; ++k) {
    const double cost_here = cost(k * kScanStepS);
    if (cost_here >= best_cost) continue;
    best = k;
    best_cost = cost_here;
  }
  if (!std::isfinite(best_cost) || std::abs(best) == steps) return std::nullopt;
  TimeOffset offset;
  offset.offset_s = Minimise(cost, (best - 1) * kScanStepS, (best + 1) * kScanStepS);
  const auto sigma = SigmaOfOffset(vectors_at, offset.offset_s);
  if (!sigma || *sigma > max_offset_s) return std::nullopt;
  offset.sigma_s = *sigma;
  return offset;
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

std::optional<Rigid3> PoseInterpolator::At(double time_s) const {
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
  return Rigid3{
      from.world_from_camera.rotation.slerp(s, to.world_from_camera.rotation).normalized(),
      from.world_from_camera.translation + s * (slope_from + s * (second + s * third))};
}

bool PoseInterpolator::Covers(double from_s, double to_s) const {
  if (!At(from_s) || !At(to_s)) return false;
  const auto earlier = [](const TimedPose& pose, double time) { return pose.time_s < time; };
  auto pose = std::lower_bound(trajectory_.begin(), trajectory_.end(), from_s, earlier);
  for (; pose != trajectory_.end() && pose->time_s < to_s; ++pose) {
    if (!IsBridged(static_cast<size_t>(pose - trajectory_.begin()))) return false;
  }
  return true;
}

std::vector<PosePair> PairPosesAtOffset(const Trajectory& estimate, const Trajectory& ground_truth,
                                        double offset_s) {
  const PoseInterpolator truth(ground_truth);
  std::vector<PosePair> pairs;
  for (const TimedPose& pose : estimate) {
    const double time_s = pose.time_s + offset_s;
    if (const auto at = truth.At(time_s)) pairs.push_back({time_s, *at, pose.world_from_camera});
  }
  return pairs;
}

std::optional<TimeOffset> EstimateTimeOffset(const Trajectory& estimate,
                                             const Trajectory& ground_truth,
                                             TrajectoryAlignment alignment, double max_offset_s) {
  const PoseInterpolator truth(ground_truth);
  const Trajectory covered = CoveredPoses(estimate, truth, max_offset_s);
  const auto positions_at = [&](double offset_s) -> std::optional<AlignedVectors> {
    std::vector<PosePair> pairs;
    for (const TimedPose& pose : covered) {
      pairs.push_back({pose.time_s, *truth.At(pose.time_s + offset_s), pose.world_from_camera});
    }
    const auto truth_from_estimate = AlignPosePairs(pairs, alignment);
    if (!truth_from_estimate) return std::nullopt;
    AlignedVectors positions;
    for (const PosePair& pair : pairs) {
      positions.truth.push_back(pair.truth.translation);
      positions.estimate.emplace_back(*truth_from_estimate * pair.estimate.translation);
    }
    return positions;
  };
  return FindOffset(positions_at, max_offset_s);
}

std::optional<TimeOffset> EstimateTimeOffsetOfRotations(const Trajectory& estimate,
                                                        const Trajectory& ground_truth,
                                                        double max_offset_s) {
  const PoseInterpolator truth(ground_truth);
  const Trajectory covered = CoveredPoses(estimate, truth, max_offset_s);
  const double max_interval_s = kBridgedIntervals * MedianInterval(covered);
  const auto rates_at = [&](double offset_s) -> std::optional<AlignedVectors> {
    AlignedVectors rates;
    for (size_t i = 1; i < covered.size(); ++i) {
      const TimedPose& from = covered[i - 1];
      const TimedPose& to = covered[i];
      const double interval_s = to.time_s - from.time_s;
      if (interval_s > max_interval_s) continue;
      rates.truth.push_back(AngularVelocity(*truth.At(from.time_s + offset_s),
                                            *truth.At(to.time_s + offset_s), interval_s));
      rates.estimate.push_back(
          AngularVelocity(from.world_from_camera, to.world_from_camera, interval_s));
    }
    const auto truth_from_estimate = AlignDirections(rates.truth, rates.estimate);
    if (!truth_from_estimate) return std::nullopt;
    for (Eigen::Vector3d& rate : rates.estimate) rate = *truth_from_estimate * rate;
    return rates;
  };
  return FindOffset(rates_at, max_offset_s);
}

}  // namespace s3lam
