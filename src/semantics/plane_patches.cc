#include "plane_patches.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "s3lam/geometry/convex_hull.h"

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

/// The inliers on either side of the widest gap along an axis that leaves `min_points` on each;
/// empty if that is no gap worth the name. Ascending each.
std::optional<std::pair<std::vector<size_t>, std::vector<size_t>>> PartAtGap(
    std::span<const UncertainPoint> points, const PlaneFit& fit, const Eigen::Vector3d& axis,
    size_t min_points) {
  constexpr double kLeastGap = 0.1;  // Of the extent.
  std::vector<std::pair<double, size_t>> along;
  for (const size_t i : fit.inliers) along.emplace_back(axis.dot(points[i].xyz), i);
  if (along.size() < 2 * min_points) return std::nullopt;
  std::sort(along.begin(), along.end());
  size_t at = 0;
  double widest = kLeastGap * (along.back().first - along.front().first);
  for (size_t k = min_points; k + min_points <= along.size(); ++k) {
    const double gap = along[k].first - along[k - 1].first;
    if (gap > widest) {
      widest = gap;
      at = k;
    }
  }
  if (at == 0) return std::nullopt;
  std::pair<std::vector<size_t>, std::vector<size_t>> parts;
  for (size_t k = 0; k < along.size(); ++k) {
    (k < at ? parts.first : parts.second).push_back(along[k].second);
  }
  std::sort(parts.first.begin(), parts.first.end());
  std::sort(parts.second.begin(), parts.second.end());
  return parts;
}

double SquaredSigmas(const PlaneFit& fit) {
  return fit.rms_sigma * fit.rms_sigma * static_cast<double>(fit.inliers.size());
}

}  // namespace

bool AreTwoSurfaces(const PlaneFit& joint, const PlaneFit& a, const PlaneFit& b) {
  constexpr double kParameters = 3.0;  // Of a plane.
  constexpr double kMinRatio = 10.0;   // 5.4 would be 99.9 %; the points are not quite independent.
  const double freedom =
      static_cast<double>(a.inliers.size() + b.inliers.size()) - 2.0 * kParameters;
  if (freedom < kParameters) return false;
  const double apart = SquaredSigmas(a) + SquaredSigmas(b);
  return (SquaredSigmas(joint) - apart) / kParameters > kMinRatio * apart / freedom;
}

PlaneFit SplitAtGaps(std::span<const UncertainPoint> points, PlaneFit fit, size_t min_points) {
  bool has_changed = true;
  while (has_changed) {
    has_changed = false;
    for (const Eigen::Vector3d& axis : {fit.axis_u, fit.axis_v}) {
      const auto parts = PartAtGap(points, fit, axis, min_points);
      if (!parts) continue;
      auto a = FitPlane(points, parts->first);
      auto b = FitPlane(points, parts->second);
      if (!a || !b || !AreTwoSurfaces(fit, *a, *b)) continue;
      fit = std::move(a->inliers.size() >= b->inliers.size() ? *a : *b);
      has_changed = true;
      break;
    }
  }
  return fit;
}

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
  const bool are_layers = LieOverEachOther(points, a, b);
  const JoinLimits& limits = are_layers ? layered : apart;
  if (angle > limits.max_angle) return std::nullopt;
  std::vector<size_t> both;
  std::set_union(a.inliers.begin(), a.inliers.end(), b.inliers.begin(), b.inliers.end(),
                 std::back_inserter(both));
  std::optional<PlaneFit> joint = FitPlane(points, both);
  if (!joint || joint->rms_sigma > limits.max_sigmas) return std::nullopt;
  if (!are_layers && AreTwoSurfaces(*joint, a, b)) return std::nullopt;
  return joint;
}

}  // namespace s3lam
