#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "s3lam/geometry/rigid3.h"

namespace s3lam {

/// A viewing ray: the camera's pose and the normalised image coordinates (x/z, y/z).
struct ViewingRay {
  Rigid3 cam_from_world;
  Eigen::Vector2d normalized = Eigen::Vector2d::Zero();
};

/// The point in the world nearest to all rays (least squares of distances to the rays, refined by
/// two Gauss-Newton steps on the normalised reprojection error). Empty if the rays are parallel to
/// numerical precision or the point is not in front of every camera.
std::optional<Eigen::Vector3d> Triangulate(std::span<const ViewingRay> rays);

/// Angle at a point between the rays to two camera centres [rad].
double ParallaxAngle(const Eigen::Vector3d& point, const Eigen::Vector3d& center_a,
                     const Eigen::Vector3d& center_b);

}  // namespace s3lam
