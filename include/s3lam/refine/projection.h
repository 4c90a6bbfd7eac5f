#pragma once

#include <Eigen/Core>

#include "s3lam/geometry/camera.h"

namespace s3lam {

using Matrix23 = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;

/// Projects a point in camera coordinates to pixels and, if `jacobian` is given, fills the
/// derivative d(pixel) / d(point in camera). Pinhole and radial models and OPENCV in closed form,
/// the others by automatic differentiation of the distortion alone (two directions). False, leaving
/// the outputs undefined, for a point on or behind the image plane or a result that is not finite.
bool ProjectPoint(CameraModel model, const double* params, const Eigen::Vector3d& point_in_camera,
                  Eigen::Vector2d* pixel, Matrix23* jacobian);

/// Derivative of the pixel by the camera's parameters, 2 x CameraModelNumParams(model), row-major.
void ProjectionParamsJacobian(CameraModel model, const double* params,
                              const Eigen::Vector3d& point_in_camera, double* jacobian);

}  // namespace s3lam
