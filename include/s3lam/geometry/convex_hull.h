#pragma once

#include <Eigen/Core>
#include <vector>

namespace s3lam {

/// The convex hull of points in the plane, counter-clockwise, without collinear corners; fewer than
/// three for points on a line.
std::vector<Eigen::Vector2d> ConvexHull(std::vector<Eigen::Vector2d> points);

}  // namespace s3lam
