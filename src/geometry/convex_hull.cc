#include "s3lam/geometry/convex_hull.h"

#include <algorithm>

namespace s3lam {
namespace {

double Cross(const Eigen::Vector2d& origin, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return (a.x() - origin.x()) * (b.y() - origin.y()) - (a.y() - origin.y()) * (b.x() - origin.x());
}

}  // namespace

std::vector<Eigen::Vector2d> ConvexHull(std::vector<Eigen::Vector2d> points) {
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  });
  points.erase(std::unique(points.begin(), points.end()), points.end());
  if (points.size() < 3) return points;
  // Andrew's monotone chain: the lower side from left to right, then the upper side back.
  std::vector<Eigen::Vector2d> hull;
  const auto add_side = [&hull](auto begin, auto end) {
    const size_t base = hull.size();
    for (auto it = begin; it != end; ++it) {
      while (hull.size() >= base + 2 && Cross(hull[hull.size() - 2], hull.back(), *it) <= 0.0) {
        hull.pop_back();
      }
      hull.push_back(*it);
    }
    hull.pop_back();  // The first of the next side.
  };
  add_side(points.begin(), points.end());
  add_side(points.rbegin(), points.rend());
  return hull;
}

}  // namespace s3lam
