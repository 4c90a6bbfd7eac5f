#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "s3lam/scene/reconstruction.h"

namespace s3lam {

/// Where the map is looked at from; z is up.
enum class MapView { kTop, kOblique, kSide };
inline constexpr MapView kMapViews[] = {MapView::kTop, MapView::kOblique, MapView::kSide};
/// "top", "oblique", "side".
const char* MapViewName(MapView view);

struct ColoredPoint {
  Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
  Rgb color{};
};

/// To the picture's right, to its top and towards the viewer.
Eigen::Matrix3d ViewAxes(MapView view);

/// The part of the world that views show, so that several maps are seen alike: the middle 98 of 100
/// points along each axis of the view, and the cameras.
struct ViewBounds {
  Eigen::Vector2d min = Eigen::Vector2d::Zero();
  Eigen::Vector2d max = Eigen::Vector2d::Ones();
};
ViewBounds BoundsOfView(MapView view, const std::vector<ColoredPoint>& points,
                        const std::vector<Eigen::Vector3d>& path);

/// Parallel projection on white, nearer points over farther ones, and the cameras' path as a line;
/// 8-bit BGR of the given width, as high as the bounds ask.
cv::Mat DrawMapView(MapView view, const ViewBounds& bounds, const std::vector<ColoredPoint>& points,
                    const std::vector<Eigen::Vector3d>& path, int width);

}  // namespace s3lam
