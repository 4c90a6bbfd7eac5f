// Objects that were seen from two sides, in images that show only one of them each.

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <map>
#include <vector>

#include "merge_pairs.h"
#include "s3lam/semantics/clusters.h"

namespace s3lam {
namespace {

constexpr double kTrimmed = 0.05;       // Of the points, at each end of each axis.
constexpr double kMargin = 1.5;         // Of the box, times its half extents.
constexpr double kMinThickness = 0.25;  // Of the box, of its longest half extent.

/// The space that an object takes up, by the points on the side of it that was seen: a box along
/// the principal axes, outliers left out, with room for the other side.
class Space {
 public:
  Space(const Reconstruction& reconstruction, const Cluster& cluster) {
    points_.reserve(cluster.points.size());
    for (const PointId id : cluster.points) points_.push_back(reconstruction.points.at(id).xyz);
    FitBox();
  }

  /// Can one have much in the other at all?
  [[nodiscard]] bool IsNear(const Space& other) const {
    const Eigen::Vector3d between =
        axes_.transpose() * center_ - other.axes_.transpose() * other.center_;
    return between.norm() < half_extent_.norm() + other.half_extent_.norm();
  }

  /// Of another object's points.
  [[nodiscard]] double ShareInside(const Space& other) const {
    const auto inside =
        std::count_if(other.points_.begin(), other.points_.end(), [&](const auto& x) {
          return ((axes_ * x - center_).cwiseAbs().array() <= half_extent_.array()).all();
        });
    return static_cast<double>(inside) / static_cast<double>(other.points_.size());
  }

 private:
  void FitBox() {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& x : points_) mean += x / static_cast<double>(points_.size());
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const Eigen::Vector3d& x : points_) scatter += (x - mean) * (x - mean).transpose();
    axes_ = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvectors().transpose();
    std::vector<double> along(points_.size());
    const auto trimmed = static_cast<size_t>(kTrimmed * static_cast<double>(points_.size() - 1));
    for (int axis = 0; axis < 3; ++axis) {
      for (size_t i = 0; i < points_.size(); ++i) along[i] = axes_.row(axis).dot(points_[i]);
      std::sort(along.begin(), along.end());
      const double low = along[trimmed];
      const double high = along[along.size() - 1 - trimmed];
      center_[axis] = 0.5 * (low + high);
      half_extent_[axis] = 0.5 * (high - low);
    }
    half_extent_ = kMargin * half_extent_.cwiseMax(kMinThickness * half_extent_.maxCoeff());
  }

  std::vector<Eigen::Vector3d> points_;
  Eigen::Matrix3d axes_ = Eigen::Matrix3d::Identity();  // By rows.
  Eigen::Vector3d center_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d half_extent_ = Eigen::Vector3d::Zero();
};

/// The spaces of clusters, by their first point, which no two have in common.
class Spaces {
 public:
  explicit Spaces(const Reconstruction& reconstruction) : reconstruction_(reconstruction) {}

  const Space& Of(const Cluster& cluster) {
    const PointId key = cluster.points.front();
    const auto it = spaces_.find(key);
    return it != spaces_.end()
               ? it->second
               : spaces_.emplace(key, Space(reconstruction_, cluster)).first->second;
  }

  void Forget(const Cluster& cluster) { spaces_.erase(cluster.points.front()); }

 private:
  const Reconstruction& reconstruction_;
  std::map<PointId, Space> spaces_;
};

/// Segments ascend by image.
bool ShareAnImage(const Cluster& a, const Cluster& b) {
  auto x = a.segments.begin();
  auto y = b.segments.begin();
  while (x != a.segments.end() && y != b.segments.end()) {
    if (x->image_id == y->image_id) return true;
    x->image_id < y->image_id ? ++x : ++y;
  }
  return false;
}

}  // namespace

int MergeSeenApart(const Reconstruction& reconstruction, const ClassTable& class_table,
                   const ClusterOptions& options, std::vector<Cluster>& clusters) {
  Spaces spaces(reconstruction);
  const auto min_points = static_cast<size_t>(options.min_points);
  const auto same_object = [&](const Cluster& a, const Cluster& b) {
    const bool is_thing = class_table.classes[static_cast<size_t>(a.class_index)].is_thing;
    if (!is_thing || std::min(a.points.size(), b.points.size()) < min_points) return false;
    const Space& space_a = spaces.Of(a);
    const Space& space_b = spaces.Of(b);
    return space_a.IsNear(space_b) && !ShareAnImage(a, b) &&
           std::max(space_a.ShareInside(space_b), space_b.ShareInside(space_a)) >
               options.min_in_space;
  };
  return MergePairs(clusters, same_object, [&](const Cluster& grown) { spaces.Forget(grown); });
}

}  // namespace s3lam
