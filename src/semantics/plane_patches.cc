#include "plane_patches.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "s3lam/semantics/plane_fitting.h"

namespace s3lam {
namespace {

/// Counter-clockwise hull of the inliers of a fit, in its plane.
std::vector<Eigen::Vector2d> Outline(std::span<const UncertainPoint> points, const PlaneFit& fit) {
  std::vector<Eigen::Vector2d> outline;
  for (const size_t i : fit.inliers) {
    const Eigen::Vector3d d = points[i].xyz - fit.centroid;
    outline.emplace_back(fit.axis_u.dot(d), fit.axis_v.dot(d));
  }
  return ConvexHull(std::move(outline));
}

bool IsInside(const std::vector<Eigen::Vector2d>& hull, const Eigen::Vector2d& x) {
  for (size_t i = 0; i < hull.size(); ++i) {
    const Eigen::Vector2d side = hull[(i + 1) % hull.size()] - hull[i];
    const Eigen::Vector2d d = x - hull[i];
    if (side.x() * d.y() - side.y() * d.x() < 0.0) return false;
  }
  return true;
}

/// True if most inliers of the smaller of two planes lie, seen along the normal of the larger one,
/// within that one's outline.
bool LieOverEachOther(std::span<const UncertainPoint> points, const PlaneFit& a,
                      const PlaneFit& b) {
  const PlaneFit& large = a.inliers.size() >= b.inliers.size() ? a : b;
  const PlaneFit& small = a.inliers.size() >= b.inliers.size() ? b : a;
  const std::vector<Eigen::Vector2d> hull = Outline(points, large);
  const auto inside = std::count_if(small.inliers.begin(), small.inliers.end(), [&](size_t i) {
    const Eigen::Vector3d d = points[i].xyz - large.centroid;
    return IsInside(hull, {large.axis_u.dot(d), large.axis_v.dot(d)});
  });
  return 2 * static_cast<size_t>(inside) > small.inliers.size();
}

}  // namespace

std::vector<size_t> LargestPatch(std::span<const UncertainPoint> points, const PlaneFit& fit,
                                 double max_gap) {
  using Cell = std::pair<int64_t, int64_t>;
  std::map<Cell, std::vector<size_t>> cells;
  for (const size_t i : fit.inliers) {
    const Eigen::Vector3d d = points[i].xyz - fit.centroid;
    cells[{static_cast<int64_t>(std::floor(fit.axis_u.dot(d) / max_gap)),
           static_cast<int64_t>(std::floor(fit.axis_v.dot(d) / max_gap))}]
        .push_back(i);
  }
  std::vector<size_t> largest;
  while (!cells.empty()) {
    std::vector<size_t> patch;
    std::vector<Cell> open = {cells.begin()->first};
    while (!open.empty()) {
      const Cell cell = open.back();
      open.pop_back();
      const auto it = cells.find(cell);
      if (it == cells.end()) continue;
      patch.insert(patch.end(), it->second.begin(), it->second.end());
      cells.erase(it);
      for (int64_t du = -1; du <= 1; ++du) {
        for (int64_t dv = -1; dv <= 1; ++dv) open.emplace_back(cell.first + du, cell.second + dv);
      }
    }
    if (patch.size() > largest.size()) largest = std::move(patch);
  }
  std::sort(largest.begin(), largest.end());
  return largest;
}

PlaneFit GatherPoints(std::span<const UncertainPoint> points, std::span<const size_t> free,
                      PlaneFit fit, double max_sigmas) {
  constexpr int kRounds = 3;
  std::vector<size_t> eligible;
  std::set_union(free.begin(), free.end(), fit.inliers.begin(), fit.inliers.end(),
                 std::back_inserter(eligible));
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<Eigen::Vector2d> hull = Outline(points, fit);
    const double limit = max_sigmas * std::max(1.0, fit.rms_sigma);
    std::vector<size_t> inliers;
    for (const size_t i : eligible) {
      const Eigen::Vector3d d = points[i].xyz - fit.centroid;
      const double distance = std::abs(fit.plane.SignedDistance(points[i].xyz));
      if (distance > limit * DistanceSigma(points[i], fit.plane.normal)) continue;
      if (IsInside(hull, {fit.axis_u.dot(d), fit.axis_v.dot(d)})) inliers.push_back(i);
    }
    auto next = FitPlane(points, inliers);
    if (!next || next->inliers.size() < fit.inliers.size() / 2) return fit;
    fit = std::move(*next);
  }
  return fit;
}

std::optional<PlaneFit> JoinPlanes(std::span<const UncertainPoint> points, const PlaneFit& a,
                                   const PlaneFit& b, const JoinLimits& apart,
                                   const JoinLimits& layered) {
  const double angle = PlaneAngle(a.plane, b.plane);
  if (angle > std::max(apart.max_angle, layered.max_angle)) return std::nullopt;
  const JoinLimits& limits = LieOverEachOther(points, a, b) ? layered : apart;
  if (angle > limits.max_angle) return std::nullopt;
  std::vector<size_t> both;
  std::set_union(a.inliers.begin(), a.inliers.end(), b.inliers.begin(), b.inliers.end(),
                 std::back_inserter(both));
  std::optional<PlaneFit> joint = FitPlane(points, both);
  if (!joint || joint->rms_sigma > limits.max_sigmas) return std::nullopt;
  return joint;
}

}  // namespace s3lam
