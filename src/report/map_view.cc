#include "s3lam/report/map_view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/imgproc.hpp>

namespace s3lam {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kSubpixelBits = 4;
// Drawn so much larger and then averaged: OpenCV's small circles are diamonds.
constexpr int kSupersampling = 2;

/// The interval that holds the middle 98 of 100 values.
std::pair<double, double> MiddleOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const double last = static_cast<double>(values.size() - 1);
  return {values[static_cast<size_t>(std::floor(0.01 * last))],
          values[static_cast<size_t>(std::ceil(0.99 * last))]};
}

}  // namespace

const char* MapViewName(MapView view) {
  switch (view) {
    case MapView::kTop:
      return "top";
    case MapView::kOblique:
      return "oblique";
    case MapView::kSide:
      break;
  }
  return "side";
}

Eigen::Matrix3d ViewAxes(MapView view) {
  Eigen::Matrix3d axes;  // Rows: right, up, towards the viewer.
  switch (view) {
    case MapView::kTop:
      axes.setIdentity();
      break;
    case MapView::kSide:
      axes << 1, 0, 0, 0, 0, 1, 0, -1, 0;
      break;
    case MapView::kOblique: {
      const Vector3d towards = Vector3d(1.0, -1.0, 0.9).normalized();
      const Vector3d right = Vector3d::UnitZ().cross(towards).normalized();
      axes << right.transpose(), towards.cross(right).transpose(), towards.transpose();
      break;
    }
  }
  return axes;
}

ViewBounds BoundsOfView(MapView view, const std::vector<ColoredPoint>& points,
                        const std::vector<Vector3d>& path) {
  const Eigen::Matrix3d axes = ViewAxes(view);
  ViewBounds bounds;
  if (points.empty() && path.empty()) return bounds;
  bounds.min.setConstant(std::numeric_limits<double>::infinity());
  bounds.max = -bounds.min;
  for (int axis = 0; axis < 2 && !points.empty(); ++axis) {
    std::vector<double> values;
    for (const ColoredPoint& point : points) values.push_back(axes.row(axis).dot(point.xyz));
    std::tie(bounds.min[axis], bounds.max[axis]) = MiddleOf(std::move(values));
  }
  for (const Vector3d& center : path) {
    const Vector2d p = (axes * center).head<2>();
    bounds.min = bounds.min.cwiseMin(p);
    bounds.max = bounds.max.cwiseMax(p);
  }
  const Vector2d margin = Vector2d::Constant(0.06 * (bounds.max - bounds.min).maxCoeff() + 1e-9);
  bounds.min -= margin;
  bounds.max += margin;
  return bounds;
}

cv::Mat DrawMapView(MapView view, const ViewBounds& bounds, const std::vector<ColoredPoint>& points,
                    const std::vector<Vector3d>& path, int width) {
  const Eigen::Matrix3d axes = ViewAxes(view);
  const Vector2d range = bounds.max - bounds.min;
  // A map that is high and narrow must not give a picture without end.
  const double scale = std::min(width / range.x(), 1.5 * width / range.y());
  const int height =
      std::clamp(static_cast<int>(std::lround(range.y() * scale)), width / 5, 3 * width / 2);
  const Vector2d middle = 0.5 * (bounds.min + bounds.max);
  const auto to_fixed = [&](const Vector2d& p) {
    const Vector2d q = (p - middle) * scale;
    const Vector2d px = kSupersampling * Vector2d(0.5 * width + q.x(), 0.5 * height - q.y());
    const Vector2d fixed = px.cwiseMax(-1e4).cwiseMin(1e5) * (1 << kSubpixelBits);
    return cv::Point(static_cast<int>(std::lround(fixed.x())),
                     static_cast<int>(std::lround(fixed.y())));
  };
  std::vector<Vector3d> in_view(points.size());
  for (size_t i = 0; i < points.size(); ++i) in_view[i] = axes * points[i].xyz;
  std::vector<size_t> order(points.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return in_view[a].z() < in_view[b].z(); });

  cv::Mat picture(kSupersampling * height, kSupersampling * width, CV_8UC3, cv::Scalar::all(255));
  const int radius = (points.size() > 50000 ? 1 : 3) << kSubpixelBits;
  for (const size_t i : order) {
    const Rgb& c = points[i].color;
    cv::circle(picture, to_fixed(in_view[i].head<2>()), radius, cv::Scalar(c[2], c[1], c[0]),
               cv::FILLED, cv::LINE_AA, kSubpixelBits);
  }
  std::vector<cv::Point> line;
  for (const Vector3d& center : path) line.push_back(to_fixed((axes * center).head<2>()));
  cv::polylines(picture, line, false, cv::Scalar(60, 60, 220), kSupersampling, cv::LINE_AA,
                kSubpixelBits);
  cv::Mat averaged;
  cv::resize(picture, averaged, {width, height}, 0.0, 0.0, cv::INTER_AREA);
  return averaged;
}

}  // namespace s3lam
