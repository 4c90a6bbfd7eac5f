// Objects that were seen from two sides, in images that show only one of them each.

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <set>
#include <vector>

#include "merge_pairs.h"
#include "s3lam/semantics/clusters.h"

namespace s3lam {
namespace {

constexpr double kTrimmed = 0.05;       // Of the points, at each end of each axis.
constexpr double kMargin = 1.5;         // Of the box, times its half extents.
constexpr double kMinThickness = 0.25;  // Of the box, of its longest half extent.

std::vector<Eigen::Vector3d> PositionsOf(const Reconstruction& reconstruction,
                                         const Cluster& cluster) {
  std::vector<Eigen::Vector3d> positions;
  positions.reserve(cluster.points.size());
  for (const PointId id : cluster.points) positions.push_back(reconstruction.points.at(id).xyz);
  return positions;
}

/// The space that an object takes up, by the points on the side of it that was seen: a box along
/// the principal axes, outliers left out, with room for the other side.
class Space {
 public:
  explicit Space(const std::vector<Eigen::Vector3d>& points) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& x : points) mean += x / static_cast<double>(points.size());
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const Eigen::Vector3d& x : points) scatter += (x - mean) * (x - mean).transpose();
    axes_ = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvectors().transpose();
    std::vector<double> along(points.size());
    const auto trimmed = static_cast<size_t>(kTrimmed * static_cast<double>(points.size() - 1));
    for (int axis = 0; axis < 3; ++axis) {
      for (size_t i = 0; i < points.size(); ++i) along[i] = axes_.row(axis).dot(points[i]);
      std::sort(along.begin(), along.end());
      const double low = along[trimmed];
      const double high = along[along.size() - 1 - trimmed];
      center_[axis] = 0.5 * (low + high);
      half_extent_[axis] = 0.5 * (high - low);
    }
    half_extent_ = kMargin * half_extent_.cwiseMax(kMinThickness * half_extent_.maxCoeff());
  }

  [[nodiscard]] double ShareInside(const std::vector<Eigen::Vector3d>& points) const {
    const auto inside = std::count_if(points.begin(), points.end(), [&](const auto& x) {
      return ((axes_ * x - center_).cwiseAbs().array() <= half_extent_.array()).all();
    });
    return static_cast<double>(inside) / static_cast<double>(points.size());
  }

 private:
  Eigen::Matrix3d axes_;  // By rows.
  Eigen::Vector3d center_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d half_extent_ = Eigen::Vector3d::Zero();
};

bool ShareAnImage(const Cluster& a, const Cluster& b) {
  std::set<ImageId> images;
  for (const SegmentRef& segment : a.segments) images.insert(segment.image_id);
  return std::any_of(b.segments.begin(), b.segments.end(),
                     [&](const SegmentRef& segment) { return images.contains(segment.image_id); });
}

}  // namespace

int MergeSeenApart(const Reconstruction& reconstruction, const ClassTable& class_table,
                   const ClusterOptions& options, std::vector<Cluster>& clusters) {
  const auto same_object = [&](const Cluster& a, const Cluster& b) {
    const bool is_thing = class_table.classes[static_cast<size_t>(a.class_index)].is_thing;
    const auto min_points = static_cast<size_t>(options.min_points);
    if (!is_thing || std::min(a.points.size(), b.points.size()) < min_points) return false;
    if (ShareAnImage(a, b)) return false;
    const auto points_a = PositionsOf(reconstruction, a);
    const auto points_b = PositionsOf(reconstruction, b);
    return std::max(Space(points_a).ShareInside(points_b), Space(points_b).ShareInside(points_a)) >
           options.min_in_space;
  };
  return MergePairs(clusters, same_object, [](const Cluster& /*grown*/) {});
}

}  // namespace s3lam
