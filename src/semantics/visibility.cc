#include "s3lam/semantics/visibility.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "s3lam/base/statistics.h"

namespace s3lam {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
constexpr double kMaxAxisAngle = std::numbers::pi / 4.0;

/// Where an image looks, and how far away what it shows is.
struct Outlook {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double median_depth = 0.0;
};

Outlook OutlookOf(const Image& image, std::vector<double> depths) {
  return {image.cam_from_world.CenterInB(),
          image.cam_from_world.rotation.conjugate() * Eigen::Vector3d::UnitZ(),
          Median(std::move(depths))};
}

/// The views nearest to one that look the same way, nearest first.
std::vector<uint32_t> FindNeighbors(const std::vector<Outlook>& outlooks, uint32_t view,
                                    const VisibilityOptions& options) {
  const double max_angle = options.max_view_angle_deg * kRadPerDeg;
  const Outlook& from = outlooks[view];
  std::vector<std::pair<double, uint32_t>> found;
  for (uint32_t i = 0; i < outlooks.size(); ++i) {
    const Outlook& other = outlooks[i];
    if (i == view) continue;
    const double distance = (other.center - from.center).norm();
    // Twice the angle, since what matters is each point's own depth.
    const double depth = from.median_depth > 0.0 ? from.median_depth : other.median_depth;
    const double max_distance = 2.0 * std::tan(max_angle) * depth;
    if (distance > max_distance || other.axis.dot(from.axis) < std::cos(kMaxAxisAngle)) continue;
    found.emplace_back(distance, i);
  }
  const size_t count = std::min(found.size(), static_cast<size_t>(options.max_neighbors));
  std::partial_sort(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(count), found.end());
  std::vector<uint32_t> neighbors;
  for (size_t i = 0; i < count; ++i) neighbors.push_back(found[i].second);
  return neighbors;
}

}  // namespace

void VisibilityOptions::Visit(OptionVisitor& v) {
  v.Value(
      "predict", predict,
      "Also look up points that an image does not observe but must show, because one taken from "
      "nearly the same place observes them.");
  v.Value("max_view_angle_deg", max_view_angle_deg,
          "Largest angle between the rays of the two images to the point [deg].", 0.0, 60.0);
  v.Value("max_depth_ratio", max_depth_ratio, "Largest ratio of its depths in the two.", 1.0);
  v.Value("max_neighbors", max_neighbors, "Nearest images that are asked.", 0);
}

VisibilityPredictor::VisibilityPredictor(const Reconstruction& reconstruction,
                                         const PointRows& rows, const VisibilityOptions& options)
    : reconstruction_(reconstruction),
      rows_(rows),
      options_(options),
      min_cosine_(std::cos(options.max_view_angle_deg * kRadPerDeg)) {
  if (!options.predict) return;
  for (const auto& [id, point] : reconstruction.points) xyz_.push_back(point.xyz);
  views_ = MakeViews();
}

std::vector<VisibilityPredictor::View> VisibilityPredictor::MakeViews() const {
  std::vector<View> views;
  std::vector<Outlook> outlooks;
  for (const auto& [id, image] : reconstruction_.images) {
    View& view = views.emplace_back();
    view.image = &image;
    view.center = image.cam_from_world.CenterInB();
    std::vector<double> depths;
    for (const Point2D& keypoint : image.points2D) {
      if (!keypoint.point_id.valid()) continue;
      view.points.push_back(rows_.RowOf(keypoint.point_id));
      depths.push_back((image.cam_from_world * xyz_[view.points.back()]).z());
    }
    std::sort(view.points.begin(), view.points.end());
    outlooks.push_back(OutlookOf(image, std::move(depths)));
  }
  for (uint32_t i = 0; i < views.size(); ++i) {
    views[i].neighbors = FindNeighbors(outlooks, i, options_);
  }
  return views;
}

bool VisibilityPredictor::SeeAlike(const View& a, const View& b, uint32_t row) const {
  const Eigen::Vector3d ray_a = xyz_[row] - a.center;
  const Eigen::Vector3d ray_b = xyz_[row] - b.center;
  const double squared_a = ray_a.squaredNorm();
  const double squared_b = ray_b.squaredNorm();
  const double squared_ratio = options_.max_depth_ratio * options_.max_depth_ratio;
  return squared_a <= squared_ratio * squared_b && squared_b <= squared_ratio * squared_a &&
         ray_a.dot(ray_b) >= min_cosine_ * std::sqrt(squared_a * squared_b);
}

std::vector<VisibilityPredictor::Prediction> VisibilityPredictor::Predict(
    const Image& image) const {
  std::vector<Prediction> predictions;
  const auto view = std::lower_bound(views_.begin(), views_.end(), image.id,
                                     [](const View& v, ImageId id) { return v.image->id < id; });
  if (view == views_.end() || view->image->id != image.id) return predictions;
  const Camera& camera = reconstruction_.CameraOf(image);
  std::vector<bool> done(xyz_.size(), false);
  for (const uint32_t row : view->points) done[row] = true;
  std::vector<uint32_t> rows;
  for (const uint32_t neighbor : view->neighbors) {
    for (const uint32_t row : views_[neighbor].points) {
      if (done[row] || !SeeAlike(*view, views_[neighbor], row)) continue;
      done[row] = true;
      rows.push_back(row);
    }
  }
  std::sort(rows.begin(), rows.end());
  for (const uint32_t row : rows) {
    const auto xy = camera.ImageFromCamera(image.cam_from_world * xyz_[row]);
    const bool inside =
        xy && xy->x() >= 0.0 && xy->y() >= 0.0 && xy->x() < camera.width && xy->y() < camera.height;
    if (inside) predictions.push_back({row, *xy});
  }
  return predictions;
}

}  // namespace s3lam
