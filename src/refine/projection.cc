#include "s3lam/refine/projection.h"

#include <ceres/jet.h>

#include <array>
#include <cmath>

namespace s3lam {
namespace {

/// Pixel and its derivative by the normalised coordinates (u, v), row-major in `d`.
struct NormalisedProjection {
  double x, y;
  double d[4];
};

/// x = f_x k(r2) u + c_x with k = 1 + k1 r2 + k2 r2^2; k' is dk/d(r2).
NormalisedProjection ProjectRadial(double fx, double fy, double cx, double cy, double k1, double k2,
                                   double u, double v) {
  const double r2 = u * u + v * v;
  const double k = 1.0 + r2 * (k1 + r2 * k2);
  const double two_dk = 2.0 * (k1 + 2.0 * k2 * r2);
  const double cross = two_dk * u * v;
  return {fx * k * u + cx,
          fy * k * v + cy,
          {fx * (k + two_dk * u * u), fx * cross, fy * cross, fy * (k + two_dk * v * v)}};
}

/// `d` are k1, k2, p1, p2: tangential terms beside the radial ones.
NormalisedProjection ProjectOpenCv(double fx, double fy, double cx, double cy, const double* d,
                                   double u, double v) {
  NormalisedProjection projected = ProjectRadial(fx, fy, cx, cy, d[0], d[1], u, v);
  const double p1 = d[2];
  const double p2 = d[3];
  const double r2 = u * u + v * v;
  const double cross = 2.0 * (p1 * u + p2 * v);
  projected.x += fx * (2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u));
  projected.y += fy * (p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v);
  projected.d[0] += fx * (2.0 * p1 * v + 6.0 * p2 * u);
  projected.d[1] += fx * cross;
  projected.d[2] += fy * cross;
  projected.d[3] += fy * (6.0 * p1 * v + 2.0 * p2 * u);
  return projected;
}

NormalisedProjection ProjectByJets(CameraModel model, const double* p, double u, double v) {
  using Jet = ceres::Jet<double, 2>;
  std::array<Jet, kMaxCameraParams> params;
  for (int i = 0; i < CameraModelNumParams(model); ++i) params[static_cast<size_t>(i)] = Jet(p[i]);
  const std::array<Jet, 3> xyz{Jet(u, 0), Jet(v, 1), Jet(1.0)};
  std::array<Jet, 2> xy;
  ImageFromCamera(model, params.data(), xyz.data(), xy.data());
  return {xy[0].a, xy[1].a, {xy[0].v[0], xy[0].v[1], xy[1].v[0], xy[1].v[1]}};
}

NormalisedProjection ProjectNormalised(CameraModel model, const double* p, double u, double v) {
  switch (model) {
    case CameraModel::kSimplePinhole:
      return {p[0] * u + p[1], p[0] * v + p[2], {p[0], 0.0, 0.0, p[0]}};
    case CameraModel::kPinhole:
      return {p[0] * u + p[2], p[1] * v + p[3], {p[0], 0.0, 0.0, p[1]}};
    case CameraModel::kSimpleRadial:
      return ProjectRadial(p[0], p[0], p[1], p[2], p[3], 0.0, u, v);
    case CameraModel::kRadial:
      return ProjectRadial(p[0], p[0], p[1], p[2], p[3], p[4], u, v);
    case CameraModel::kOpenCv:
      return ProjectOpenCv(p[0], p[1], p[2], p[3], p + 4, u, v);
    default:
      return ProjectByJets(model, p, u, v);
  }
}

template <int kNumParams>
void ParamsJacobianByJets(CameraModel model, const double* params,
                          const Eigen::Vector3d& point_in_camera, double* jacobian) {
  using Jet = ceres::Jet<double, kNumParams>;
  const int n = CameraModelNumParams(model);
  std::array<Jet, kNumParams> p;
  for (int i = 0; i < n; ++i) p[static_cast<size_t>(i)] = Jet(params[i], i);
  const std::array<Jet, 3> xyz{Jet(point_in_camera.x()), Jet(point_in_camera.y()),
                               Jet(point_in_camera.z())};
  std::array<Jet, 2> xy;
  ImageFromCamera(model, p.data(), xyz.data(), xy.data());
  for (int i = 0; i < n; ++i) {
    jacobian[i] = xy[0].v[i];
    jacobian[n + i] = xy[1].v[i];
  }
}

}  // namespace

bool ProjectPoint(CameraModel model, const double* params, const Eigen::Vector3d& point_in_camera,
                  Eigen::Vector2d* pixel, Matrix23* jacobian) {
  const double z = point_in_camera.z();
  if (!(z > 0.0)) return false;
  const double inverse_z = 1.0 / z;
  const double u = point_in_camera.x() * inverse_z;
  const double v = point_in_camera.y() * inverse_z;
  const NormalisedProjection projected = ProjectNormalised(model, params, u, v);
  if (!std::isfinite(projected.x) || !std::isfinite(projected.y)) return false;
  *pixel = {projected.x, projected.y};
  if (jacobian == nullptr) return true;
  // Chain rule through u = x / z, v = y / z.
  for (int row = 0; row < 2; ++row) {
    const double du = projected.d[2 * row] * inverse_z;
    const double dv = projected.d[2 * row + 1] * inverse_z;
    (*jacobian)(row, 0) = du;
    (*jacobian)(row, 1) = dv;
    (*jacobian)(row, 2) = -(du * u + dv * v);
  }
  return jacobian->allFinite();
}

void ProjectionParamsJacobian(CameraModel model, const double* params,
                              const Eigen::Vector3d& point_in_camera, double* jacobian) {
  // Of all models but one the derivatives fill whole vector registers.
  constexpr int kFew = 8;
  if (CameraModelNumParams(model) <= kFew) {
    ParamsJacobianByJets<kFew>(model, params, point_in_camera, jacobian);
  } else {
    ParamsJacobianByJets<kMaxCameraParams>(model, params, point_in_camera, jacobian);
  }
}

}  // namespace s3lam
