#include "s3lam/geometry/camera.h"

#include <ceres/jet.h>
#include <Eigen/LU>
#include <array>
#include <numeric>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

struct ModelInfo {
  std::string_view name;
  int num_params;
  bool single_focal;
};

constexpr std::array<ModelInfo, kNumCameraModels> kModels{{
    {"SIMPLE_PINHOLE", 3, true},
    {"PINHOLE", 4, false},
    {"SIMPLE_RADIAL", 4, true},
    {"RADIAL", 5, true},
    {"OPENCV", 8, false},
    {"OPENCV_FISHEYE", 8, false},
    {"FULL_OPENCV", 12, false},
    {"FOV", 5, false},
    {"SIMPLE_RADIAL_FISHEYE", 4, true},
    {"RADIAL_FISHEYE", 5, true},
}};

const ModelInfo& Info(CameraModel model) { return kModels[static_cast<size_t>(model)]; }

}  // namespace

std::string_view CameraModelName(CameraModel model) { return Info(model).name; }
int CameraModelNumParams(CameraModel model) { return Info(model).num_params; }
bool CameraModelHasSingleFocal(CameraModel model) { return Info(model).single_focal; }

std::string SupportedCameraModels() {
  std::string names;
  for (const ModelInfo& info : kModels) {
    if (!names.empty()) names += ", ";
    names += info.name;
  }
  return names;
}

std::vector<int> CameraModelPinholeParams(CameraModel model) {
  std::vector<int> params(CameraModelHasSingleFocal(model) ? 3 : 4);
  std::iota(params.begin(), params.end(), 0);
  return params;
}

int CameraModelNumDistortion(CameraModel model) {
  return CameraModelNumParams(model) - (CameraModelHasSingleFocal(model) ? 3 : 4);
}

std::vector<int> CameraModelRadialParams(CameraModel model) {
  switch (model) {
    case CameraModel::kSimplePinhole:
    case CameraModel::kPinhole:
      return {};
    case CameraModel::kSimpleRadial:
    case CameraModel::kSimpleRadialFisheye:
      return {3};
    case CameraModel::kRadial:
    case CameraModel::kRadialFisheye:
      return {3, 4};
    case CameraModel::kOpenCv:
      return {4, 5};
    case CameraModel::kOpenCvFisheye:
      return {4, 5, 6, 7};
    case CameraModel::kFullOpenCv:
      return {4, 5, 8};
    case CameraModel::kFov:
      return {4};
  }
  return {};
}

std::optional<CameraModel> CameraModelFromName(std::string_view name) {
  for (int id = 0; id < kNumCameraModels; ++id) {
    if (kModels[static_cast<size_t>(id)].name == name) return static_cast<CameraModel>(id);
  }
  return std::nullopt;
}

std::optional<CameraModel> CameraModelFromId(int id) {
  if (id < 0 || id >= kNumCameraModels) return std::nullopt;
  return static_cast<CameraModel>(id);
}

std::optional<Eigen::Vector2d> Camera::ImageFromCamera(const Eigen::Vector3d& xyz) const {
  if (!(xyz.z() > 0.0)) return std::nullopt;
  Eigen::Vector2d xy;
  s3lam::ImageFromCamera(model, params.data(), xyz.data(), xy.data());
  if (!xy.allFinite()) return std::nullopt;
  return xy;
}

std::optional<Eigen::Vector2d> Camera::CameraFromImage(const Eigen::Vector2d& xy) const {
  return CameraFromImage(xy,
                         {(xy.x() - PrincipalX()) / FocalX(), (xy.y() - PrincipalY()) / FocalY()});
}

std::optional<Eigen::Vector2d> Camera::CameraFromImage(const Eigen::Vector2d& xy,
                                                       const Eigen::Vector2d& guess) const {
  using Jet = ceres::Jet<double, 2>;
  constexpr int kMaxIterations = 50;
  constexpr double kTolerancePx = 1e-8;
  std::array<Jet, kMaxCameraParams> p;
  for (size_t i = 0; i < params.size(); ++i) p[i] = Jet(params[i]);
  Eigen::Vector2d uv = guess;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const std::array<Jet, 3> xyz{Jet(uv.x(), 0), Jet(uv.y(), 1), Jet(1.0)};
    std::array<Jet, 2> projected;
    s3lam::ImageFromCamera(model, p.data(), xyz.data(), projected.data());
    const Eigen::Vector2d error(projected[0].a - xy.x(), projected[1].a - xy.y());
    if (!error.allFinite()) return std::nullopt;
    Eigen::Matrix2d jacobian;
    jacobian.row(0) = projected[0].v.transpose();
    jacobian.row(1) = projected[1].v.transpose();
    if (error.norm() < kTolerancePx) {
      // A strong distortion maps several rays to one pixel; only around the axis, where both
      // derivatives are positive, does the model describe a lens.
      const double trace = jacobian(0, 0) / FocalX() + jacobian(1, 1) / FocalY();
      if (jacobian.determinant() <= 0.0 || trace <= 0.0) return std::nullopt;
      return uv;
    }
    if (std::abs(jacobian.determinant()) < 1e-12) return std::nullopt;
    uv -= jacobian.inverse() * error;
  }
  return std::nullopt;
}

void Camera::Check(std::string_view source) const {
  if (width <= 0 || height <= 0) {
    ThrowInputError("{}: camera size {} x {} is not positive", source, width, height);
  }
  if (params.size() != static_cast<size_t>(CameraModelNumParams(model))) {
    ThrowInputError("{}: camera model {} has {} parameters, got {}", source, CameraModelName(model),
                    CameraModelNumParams(model), params.size());
  }
  for (const double param : params) {
    if (!std::isfinite(param)) ThrowInputError("{}: camera parameter is not finite", source);
  }
  if (!(FocalX() > 0.0) || !(FocalY() > 0.0)) {
    ThrowInputError("{}: focal length must be positive", source);
  }
}

}  // namespace s3lam
