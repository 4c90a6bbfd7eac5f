#include "pair_evaluator.h"

#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>

#include "s3lam/base/statistics.h"
#include "s3lam/geometry/triangulation.h"
#include "s3lam/optim/pose_refinement.h"
#include "s3lam/robust/relative_pose.h"

namespace s3lam::internal {
namespace {

constexpr double kCappedError = 9.0;  // [sigma^2]
constexpr int kRotationRounds = 3;
/// Of a map over a mere rotation. Depths alone, one more unknown to a track's eight coordinates,
/// give 1.2 where there is no parallax, and chance 1.8 at the most.
constexpr double kMinErrorGain = 2.5;
constexpr double kFarthest = 1e4;     // [distances between the outer views]
constexpr double kLowQuantile = 0.2;  // Of the parallaxes: also what is far must be seen well.
constexpr double kDegrees = 180.0 / std::numbers::pi;

/// Is the point one without parallax to speak of, which stands for a direction?
bool IsFar(const Eigen::Vector3d& point) { return point.norm() > 0.5 * kFarthest; }

bool IsSameMotion(const Rigid3& a, const Rigid3& b) {
  constexpr double kSameTurn = 0.01;      // [rad]
  constexpr double kSameDirection = 0.1;  // [rad]
  const double cosine = a.translation.normalized().dot(b.translation.normalized());
  return RotationAngle(a.rotation, b.rotation) < kSameTurn && cosine > std::cos(kSameDirection);
}

/// The pair of the smallest error, and what it says of the other motions that would do as well.
std::optional<InitialPair> BestOf(std::vector<InitialPair> pairs, double rotation_only_error) {
  std::stable_sort(pairs.begin(), pairs.end(), [](const InitialPair& a, const InitialPair& b) {
    return a.mean_squared_error < b.mean_squared_error;
  });
  std::vector<Rigid3> motions;
  for (const InitialPair& pair : pairs) {
    const bool is_known = std::any_of(motions.begin(), motions.end(), [&](const Rigid3& motion) {
      return IsSameMotion(motion, pair.b_from_a);
    });
    if (is_known || rotation_only_error < kMinErrorGain * pair.mean_squared_error) continue;
    motions.push_back(pair.b_from_a);
    if (motions.size() == 2) pairs.front().other_error = pair.mean_squared_error;
  }
  if (motions.empty()) return std::nullopt;
  pairs.front().rotation_only_error = rotation_only_error;
  pairs.front().num_other_motions = static_cast<int>(motions.size()) - 1;
  return std::move(pairs.front());
}

}  // namespace

void PairEvaluator::ChooseViews(int start, int gap) {
  const int steps = std::min(gap, kViewsOfPair - 1);
  views_.clear();
  for (int i = 0; i <= steps; ++i) views_.push_back(start + i * gap / steps);
}

std::optional<InitialPair> PairEvaluator::Evaluate(int start, int gap,
                                                   const std::vector<Track>& tracks) {
  ChooseViews(start, gap);
  tracks_.clear();
  for (const Track& track : tracks) {
    if (track.keypoint_of_frame[gap] >= 0) tracks_.push_back(&track);
  }
  if (static_cast<int>(tracks_.size()) < options_.min_matches) return std::nullopt;
  std::vector<Eigen::Vector2d> normalized_a;
  std::vector<Eigen::Vector2d> normalized_b;
  for (const Track* track : tracks_) {
    normalized_a.push_back(camera_.Normalize(*Pixel(*track, 0)));
    normalized_b.push_back(camera_.Normalize(*Pixel(*track, NumViews() - 1)));
  }
  const double threshold = 2.0 / (0.5 * (camera_.fx + camera_.fy));
  std::vector<InitialPair> pairs;
  for (const Rigid3& b_from_a :
       RelativePoseCandidates(normalized_a, normalized_b, threshold, options_.seed)) {
    if (auto pair = EvaluateMotion(b_from_a)) pairs.push_back(std::move(*pair));
  }
  if (pairs.empty()) return std::nullopt;
  std::optional<InitialPair> best = BestOf(std::move(pairs), RotationOnlyError());
  if (!best || static_cast<int>(best->points.size()) < options_.min_points ||
      best->parallax_deg < options_.min_parallax_deg) {
    return std::nullopt;
  }
  return best;
}

std::optional<InitialPair> PairEvaluator::EvaluateMotion(const Rigid3& b_from_a) const {
  BaProblem problem;
  problem.camera = camera_;
  problem.pose_is_fixed.assign(views_.size(), 0);
  problem.pose_is_fixed.front() = 1;
  problem.poses.assign(views_.size(), Rigid3{});
  problem.poses.back() = b_from_a;
  std::vector<int> point_of_track = TriangulateTracks(b_from_a, problem);
  if (static_cast<int>(problem.points.size()) < options_.min_points ||
      problem.points.size() * 2 < tracks_.size()) {
    return std::nullopt;
  }
  if (!PoseInnerViews(point_of_track, problem)) return std::nullopt;
  AddObservations(point_of_track, problem);
  BundleAdjustmentOptions ba;
  ba.max_iterations = 15;
  if (!AdjustBundle(ba, problem).usable) return std::nullopt;
  return Score(point_of_track, problem);
}

std::vector<int> PairEvaluator::TriangulateTracks(const Rigid3& b_from_a,
                                                  BaProblem& problem) const {
  std::vector<int> point_of_track(tracks_.size(), -1);
  for (size_t t = 0; t < tracks_.size(); ++t) {
    const Eigen::Vector2d a = *Pixel(*tracks_[t], 0);
    const Eigen::Vector2d b = *Pixel(*tracks_[t], NumViews() - 1);
    const std::array<ViewingRay, 2> rays{ViewingRay{Rigid3{}, camera_.Normalize(a)},
                                         ViewingRay{b_from_a, camera_.Normalize(b)}};
    auto point = Triangulate(rays);
    if (!point || point->norm() > kFarthest) point = kFarthest * Bearing(a);
    const double error =
        SquaredError(camera_, Rigid3{}, *point, a, InverseSigma(*tracks_[t], 0)) +
        SquaredError(camera_, b_from_a, *point, b, InverseSigma(*tracks_[t], NumViews() - 1));
    if (error > 2.0 * kCappedError) continue;
    point_of_track[t] = static_cast<int>(problem.points.size());
    problem.points.push_back(*point);
  }
  return point_of_track;
}

double PairEvaluator::RotationOnlyError() const {
  std::vector<Eigen::Vector3d> directions;  // Per track, in the first view.
  for (const Track* track : tracks_) directions.push_back(Bearing(*Pixel(*track, 0)));
  std::vector<Rigid3> turns(views_.size());
  for (int round = 0; round < kRotationRounds; ++round) {
    for (int view = 0; view < NumViews(); ++view) turns[view] = FitTurn(directions, view);
    directions = MeanDirections(turns);
  }
  double sum = 0.0;
  size_t count = 0;
  for (int view = 0; view < NumViews(); ++view) {
    for (size_t t = 0; t < tracks_.size(); ++t) {
      const auto pixel = Pixel(*tracks_[t], view);
      if (!pixel) continue;
      sum += std::min(SquaredError(camera_, turns[view], directions[t], *pixel,
                                   InverseSigma(*tracks_[t], view)),
                      kCappedError);
      ++count;
    }
  }
  return count > 0 ? sum / static_cast<double>(count) : 0.0;
}

std::vector<Eigen::Vector3d> PairEvaluator::MeanDirections(const std::vector<Rigid3>& turns) const {
  std::vector<Eigen::Vector3d> directions(tracks_.size(), Eigen::Vector3d::Zero());
  for (int view = 0; view < NumViews(); ++view) {
    for (size_t t = 0; t < tracks_.size(); ++t) {
      const auto pixel = Pixel(*tracks_[t], view);
      if (!pixel) continue;
      const double inverse_sigma = InverseSigma(*tracks_[t], view);
      directions[t] +=
          inverse_sigma * inverse_sigma * (turns[view].rotation.conjugate() * Bearing(*pixel));
    }
  }
  for (Eigen::Vector3d& direction : directions) direction.normalize();
  return directions;
}

Rigid3 PairEvaluator::FitTurn(const std::vector<Eigen::Vector3d>& directions, int view) const {
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  std::vector<Eigen::Vector2d> pixels;
  std::vector<double> inverse_sigmas;
  for (size_t t = 0; t < tracks_.size(); ++t) {
    const auto pixel = Pixel(*tracks_[t], view);
    if (!pixel) continue;
    from.push_back(directions[t]);
    to.push_back(Bearing(*pixel));
    pixels.push_back(*pixel);
    inverse_sigmas.push_back(InverseSigma(*tracks_[t], view));
  }
  return FitRotation(from, to, pixels, inverse_sigmas);
}

Rigid3 PairEvaluator::FitRotation(const std::vector<Eigen::Vector3d>& from,
                                  const std::vector<Eigen::Vector3d>& to,
                                  const std::vector<Eigen::Vector2d>& pixels,
                                  const std::vector<double>& inverse_sigmas) const {
  Rigid3 turn;
  std::vector<size_t> order(from.size());
  std::iota(order.begin(), order.end(), size_t{0});
  for (int round = 0; round < 4; ++round) {
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (const size_t i : order) covariance += to[i] * from[i].transpose();
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                                Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Vector3d signs = Eigen::Vector3d::Ones();
    signs[2] = svd.matrixU().determinant() * svd.matrixV().determinant();
    const Eigen::Matrix3d rotation = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
    turn.rotation = Eigen::Quaterniond(rotation).normalized();
    std::vector<double> errors(from.size());
    for (size_t i = 0; i < from.size(); ++i) {
      errors[i] = SquaredError(camera_, turn, from[i], pixels[i], inverse_sigmas[i]);
    }
    order.resize(from.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](size_t a, size_t b) { return errors[a] < errors[b]; });
    order.resize(std::max<size_t>(3, order.size() / 2));
  }
  return turn;
}

bool PairEvaluator::PoseInnerViews(const std::vector<int>& point_of_track,
                                   BaProblem& problem) const {
  for (int view = 1; view < NumViews() - 1; ++view) {
    const double share = static_cast<double>(views_[view] - views_[0]) /
                         static_cast<double>(views_.back() - views_[0]);
    Rigid3& pose = problem.poses[view];
    pose.rotation = Eigen::Quaterniond::Identity().slerp(share, problem.poses.back().rotation);
    pose.translation = share * problem.poses.back().translation;
    std::vector<PoseObservation> observations;
    for (size_t t = 0; t < tracks_.size(); ++t) {
      const auto pixel = Pixel(*tracks_[t], view);
      if (point_of_track[t] < 0 || !pixel) continue;
      observations.push_back(
          {problem.points[point_of_track[t]], *pixel, InverseSigma(*tracks_[t], view)});
    }
    if (observations.size() < 10) return false;
    if (RefinePose(camera_, observations, pose).num_inliers < 10) return false;
  }
  return true;
}

void PairEvaluator::AddObservations(const std::vector<int>& point_of_track,
                                    BaProblem& problem) const {
  for (size_t t = 0; t < tracks_.size(); ++t) {
    if (point_of_track[t] < 0) continue;
    for (int view = 0; view < NumViews(); ++view) {
      const auto pixel = Pixel(*tracks_[t], view);
      if (!pixel) continue;
      problem.observations.push_back(
          {view, point_of_track[t], *pixel, InverseSigma(*tracks_[t], view)});
    }
  }
}

std::optional<InitialPair> PairEvaluator::Score(const std::vector<int>& point_of_track,
                                                const BaProblem& problem) const {
  std::vector<double> worst(problem.points.size(), 0.0);
  double sum = 0.0;
  size_t count = 0;
  for (const BaObservation& o : problem.observations) {
    const double error = SquaredError(camera_, problem.poses[o.pose], problem.points[o.point], o.xy,
                                      o.inverse_sigma);
    worst[o.point] = std::max(worst[o.point], error);
    sum += std::min(error, kCappedError);
    ++count;
  }
  const size_t num_lost = tracks_.size() - problem.points.size();
  sum += kCappedError * NumViews() * static_cast<double>(num_lost);
  count += num_lost * NumViews();
  InitialPair pair;
  pair.frame_a = views_.front();
  pair.frame_b = views_.back();
  pair.b_from_a = problem.poses.back();
  pair.mean_squared_error = sum / static_cast<double>(count);
  std::vector<double> depths;
  std::vector<double> angles;
  for (size_t t = 0; t < tracks_.size(); ++t) {
    const int p = point_of_track[t];
    if (p < 0 || worst[p] > 5.991) continue;
    const Eigen::Vector3d& x = problem.points[p];
    if (x.z() <= 0.0 || (pair.b_from_a * x).z() <= 0.0 || IsFar(x)) continue;
    pair.points.push_back({KeypointOf(*tracks_[t], 0), KeypointOf(*tracks_[t], NumViews() - 1), x});
    depths.push_back(x.z());
    angles.push_back(ParallaxAngle(x, Eigen::Vector3d::Zero(), pair.b_from_a.CenterInB()) *
                     kDegrees);
  }
  if (pair.points.empty()) return std::nullopt;
  pair.parallax_deg = Median(angles);
  pair.low_parallax_deg = UpperQuantile(std::move(angles), kLowQuantile);
  const double scale = 1.0 / Median(std::move(depths));
  pair.b_from_a.translation *= scale;
  for (InitialPoint& point : pair.points) point.position *= scale;
  return pair;
}

}  // namespace s3lam::internal
