#include "s3lam/refine/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "s3lam/base/statistics.h"
#include "s3lam/refine/projection.h"
#include "s3lam/refine/relations.h"
#include "s3lam/robust/plane_fit.h"

namespace s3lam {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;
/// Planes within this of parallel or orthogonal in the input are listed as a pair.
constexpr double kPairAngleDeg = 8.0;
/// Only the planes with the most points are compared with each other.
constexpr size_t kMaxPlanesInPairs = 12;

double ReprojectionRms(const BundleProblem& problem, const ArmState& state) {
  std::vector<Rigid3> poses;
  for (const PoseBlock& pose : state.poses) poses.push_back(FromPoseBlock(pose.data()));
  double sum = 0.0;
  size_t count = 0;
  for (const BundleObservation& o : problem.observations) {
    const Camera& camera = state.cameras[problem.camera_of_pose[o.pose]];
    Eigen::Vector2d pixel;
    if (!ProjectPoint(camera.model, camera.params.data(), poses[o.pose] * state.points[o.point],
                      &pixel, nullptr)) {
      continue;
    }
    sum += (pixel - o.pixel).squaredNorm();
    ++count;
  }
  return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0.0;
}

struct FittedPlane {
  bool valid = false;
  Plane plane;
  double sum_squared = 0.0;        // [map units^2]
  double sum_squared_sigma = 0.0;  // [sigma^2]
  size_t count = 0;
};

FittedPlane FitMembers(const ArmState& state, const PlaneModel& model, const PlaneState& plane,
                       const PlaneSigmaOptions& sigma, double sigma_px) {
  std::vector<UncertainPoint> points;
  std::vector<size_t> all;
  for (const int i : plane.members) {
    const double s = PlaneSigma(sigma, model, sigma_px, plane, i);
    all.push_back(points.size());
    points.push_back({state.points[i], s * s * Eigen::Matrix3d::Identity()});
  }
  FittedPlane fitted;
  const auto fit = FitPlane(points, all);
  if (!fit) return fitted;
  fitted.valid = true;
  fitted.plane = fit->plane;
  fitted.count = points.size();
  for (const UncertainPoint& point : points) {
    const double squared = std::pow(fit->plane.SignedDistance(point.xyz), 2);
    fitted.sum_squared += squared;
    fitted.sum_squared_sigma += squared / point.covariance(0, 0);
  }
  return fitted;
}

ArmReport CompareWithInput(const ArmState& input, const ArmState& state,
                           const BundleProblem& problem) {
  ArmReport arm;
  arm.name = state.name;
  arm.reprojection_rms_px = ReprojectionRms(problem, state);
  const std::vector<uint8_t> pose_used = problem.UsedPoses();
  std::vector<uint8_t> point_used(state.points.size(), 0);
  for (const BundleObservation& o : problem.observations) point_used[o.point] = 1;
  std::vector<double> moved;
  for (size_t i = 0; i < state.poses.size(); ++i) {
    if (pose_used[i] == 0) continue;
    const Rigid3 before = FromPoseBlock(input.poses[i].data());
    const Rigid3 after = FromPoseBlock(state.poses[i].data());
    moved.push_back((after.CenterInB() - before.CenterInB()).norm());
    arm.pose_moved_max = std::max(arm.pose_moved_max, moved.back());
    arm.rotation_moved_max_deg = std::max(
        arm.rotation_moved_max_deg, kDegrees * RotationAngle(before.rotation, after.rotation));
  }
  arm.pose_moved_median = Median(std::move(moved));
  std::vector<double> points_moved;
  for (size_t j = 0; j < state.points.size(); ++j) {
    if (point_used[j] != 0) points_moved.push_back((state.points[j] - input.points[j]).norm());
  }
  arm.point_moved_median = Median(std::move(points_moved));
  return arm;
}

/// fits[plane][arm].
using Fits = std::vector<std::vector<FittedPlane>>;

void ReportPlanes(const PlaneModel& model, const ClassTable& classes, const Fits& fits,
                  RefineReport& report) {
  for (size_t k = 0; k < model.planes.size(); ++k) {
    const PlaneState& state = model.planes[k];
    if (!state.in_use || fits[k].empty() || !fits[k].front().valid) continue;
    PlaneReport plane;
    plane.id = state.id;
    plane.class_name = classes.classes.at(state.class_index).name;
    plane.points = state.members.size();
    plane.kappa = state.kappa;
    for (const FittedPlane& fit : fits[k]) {
      const double n = static_cast<double>(std::max<size_t>(1, fit.count));
      plane.rms.push_back(std::sqrt(fit.sum_squared / n));
      plane.rms_sigma.push_back(std::sqrt(fit.sum_squared_sigma / n));
    }
    plane.turned_deg = kDegrees * PlaneAngle(fits[k].front().plane, fits[k].back().plane);
    report.planes.push_back(std::move(plane));
  }
}

void ReportPairs(const PlaneModel& model, const BundleProblem& problem, const Fits& fits,
                 RefineReport& report) {
  std::vector<size_t> order;
  for (size_t k = 0; k < model.planes.size(); ++k) {
    const bool all_valid =
        std::all_of(fits[k].begin(), fits[k].end(), [](const auto& fit) { return fit.valid; });
    if (model.planes[k].in_use && !fits[k].empty() && all_valid) order.push_back(k);
  }
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return model.planes[a].members.size() > model.planes[b].members.size();
  });
  if (order.size() > kMaxPlanesInPairs) order.resize(kMaxPlanesInPairs);
  std::sort(order.begin(), order.end());
  for (size_t i = 0; i < order.size(); ++i) {
    for (size_t j = i + 1; j < order.size(); ++j) {
      const auto& a = fits[order[i]];
      const auto& b = fits[order[j]];
      const double angle = kDegrees * PlaneAngle(a.front().plane, b.front().plane);
      if (angle > kPairAngleDeg && angle < 90.0 - kPairAngleDeg) continue;
      PlanePairReport pair;
      pair.a = model.planes[order[i]].id;
      pair.b = model.planes[order[j]].id;
      pair.relation = angle < 45.0 ? PlaneRelation::kParallel : PlaneRelation::kOrthogonal;
      for (const RelationTerm& term : problem.relations) {
        const auto [low, high] = std::minmax(term.plane_a, term.plane_b);
        pair.enforced |= low == static_cast<int>(order[i]) && high == static_cast<int>(order[j]);
      }
      for (size_t arm = 0; arm < a.size(); ++arm) {
        const double deviation = kDegrees * PlaneAngle(a[arm].plane, b[arm].plane);
        pair.deviation_deg.push_back(pair.relation == PlaneRelation::kParallel ? deviation
                                                                               : 90.0 - deviation);
      }
      report.pairs.push_back(std::move(pair));
    }
  }
}

void ReportDistances(const PlaneModel& model, const BundleProblem& problem, const Fits& fits,
                     RefineReport& report) {
  for (const RelationTerm& term : problem.relations) {
    if (term.relation != PlaneRelation::kAtDistance) continue;
    PlaneDistanceReport pair{
        model.planes[term.plane_a].id, model.planes[term.plane_b].id, std::abs(term.distance), {}};
    const auto& a = fits[term.plane_a];
    const auto& b = fits[term.plane_b];
    for (size_t arm = 0; arm < std::min(a.size(), b.size()); ++arm) {
      pair.measured.push_back(
          std::abs(StepBetween(a[arm].plane, b[arm].plane, term.place_in_world)));
    }
    if (pair.measured.size() == report.arms.size()) report.distances.push_back(std::move(pair));
  }
}

}  // namespace

void CompareArms(const std::vector<ArmState>& states, const BundleMap& map, const PlaneModel& model,
                 const PlaneSigmaOptions& sigma, double sigma_px, const ClassTable& classes,
                 RefineReport& report) {
  Fits fits(model.planes.size());
  for (const ArmState& state : states) {
    ArmReport arm = CompareWithInput(states.front(), state, map.problem);
    double squared = 0.0;
    double squared_sigma = 0.0;
    size_t count = 0;
    for (size_t k = 0; k < model.planes.size(); ++k) {
      if (model.planes[k].members.empty()) continue;
      fits[k].push_back(FitMembers(state, model, model.planes[k], sigma, sigma_px));
      squared += fits[k].back().sum_squared;
      squared_sigma += fits[k].back().sum_squared_sigma;
      count += fits[k].back().count;
    }
    if (count > 0) {
      arm.plane_rms = std::sqrt(squared / static_cast<double>(count));
      arm.plane_rms_sigma = std::sqrt(squared_sigma / static_cast<double>(count));
    }
    report.arms.push_back(std::move(arm));
  }
  ReportPlanes(model, classes, fits, report);
  ReportPairs(model, map.problem, fits, report);
  ReportDistances(model, map.problem, fits, report);
}

}  // namespace s3lam
