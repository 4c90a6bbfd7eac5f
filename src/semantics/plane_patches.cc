#include "plane_patches.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace s3lam {

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

std::optional<PlaneFit> JoinPlanes(std::span<const UncertainPoint> points, const PlaneFit& a,
                                   const PlaneFit& b, double max_angle, double max_sigmas) {
  if (PlaneAngle(a.plane, b.plane) > max_angle) return std::nullopt;
  std::vector<size_t> both;
  std::set_union(a.inliers.begin(), a.inliers.end(), b.inliers.begin(), b.inliers.end(),
                 std::back_inserter(both));
  std::optional<PlaneFit> joint = FitPlane(points, both);
  if (!joint || joint->rms_sigma > max_sigmas) return std::nullopt;
  return joint;
}

}  // namespace s3lam
