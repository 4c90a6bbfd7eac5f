#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "s3lam/base/id.h"

namespace s3lam {

/// COLMAP's camera models, with COLMAP's ids and parameter order.
enum class CameraModel : int {
  kSimplePinhole = 0,        // f, cx, cy
  kPinhole = 1,              // fx, fy, cx, cy
  kSimpleRadial = 2,         // f, cx, cy, k
  kRadial = 3,               // f, cx, cy, k1, k2
  kOpenCv = 4,               // fx, fy, cx, cy, k1, k2, p1, p2
  kOpenCvFisheye = 5,        // fx, fy, cx, cy, k1, k2, k3, k4
  kFullOpenCv = 6,           // fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6
  kFov = 7,                  // fx, fy, cx, cy, omega
  kSimpleRadialFisheye = 8,  // f, cx, cy, k
  kRadialFisheye = 9,        // f, cx, cy, k1, k2
};
inline constexpr int kNumCameraModels = 10;
inline constexpr int kMaxCameraParams = 12;

/// "SIMPLE_PINHOLE", ...
std::string_view CameraModelName(CameraModel model);
/// All names with commas between them, for messages.
std::string SupportedCameraModels();
std::optional<CameraModel> CameraModelFromName(std::string_view name);
/// Empty for an id that is unknown or not supported.
std::optional<CameraModel> CameraModelFromId(int id);
/// Number of parameters, kMaxCameraParams at the most.
int CameraModelNumParams(CameraModel model);
/// True if the model has one focal length for both axes.
bool CameraModelHasSingleFocal(CameraModel model);

/// Focal lengths and principal point, by their indices.
std::vector<int> CameraModelPinholeParams(CameraModel model);

/// Parameters of a camera model beyond focal lengths and principal point.
int CameraModelNumDistortion(CameraModel model);
/// Those of them that say how far from the centre a ray goes through the image, by their indices;
/// of FULL_OPENCV the polynomial's. The others are tangential, or a denominator's.
std::vector<int> CameraModelRadialParams(CameraModel model);

/// Projects a point in camera coordinates (z > 0) to pixels (COLMAP's convention: the centre of the
/// first pixel is (0.5, 0.5)). Formulas as in COLMAP and OpenCV: distortion of the normalised
/// coordinates (x/z, y/z), fisheye models of the angle to the axis.
template <typename T>
void ImageFromCamera(CameraModel model, const T* params, const T* xyz, T* xy);

/// One physical camera.
struct Camera {
  CameraId id;
  CameraModel model = CameraModel::kPinhole;
  int width = 0;   // px
  int height = 0;  // px
  std::vector<double> params;

  [[nodiscard]] double FocalX() const { return params[0]; }
  [[nodiscard]] double FocalY() const { return params[CameraModelHasSingleFocal(model) ? 0 : 1]; }
  [[nodiscard]] double MeanFocal() const { return 0.5 * (FocalX() + FocalY()); }
  [[nodiscard]] double PrincipalX() const {
    return params[CameraModelHasSingleFocal(model) ? 1 : 2];
  }
  [[nodiscard]] double PrincipalY() const {
    return params[CameraModelHasSingleFocal(model) ? 2 : 3];
  }

  /// Pixel [px] of a point in camera coordinates; empty for a point on or behind the image plane.
  [[nodiscard]] std::optional<Eigen::Vector2d> ImageFromCamera(const Eigen::Vector3d& xyz) const;
  /// Normalised coordinates (x/z, y/z) of a pixel, by Newton iteration on the distortion; empty if
  /// it does not converge, or only to a ray beyond the radius where the distortion folds back.
  [[nodiscard]] std::optional<Eigen::Vector2d> CameraFromImage(const Eigen::Vector2d& xy) const;
  /// The same, started from a guess.
  [[nodiscard]] std::optional<Eigen::Vector2d> CameraFromImage(const Eigen::Vector2d& xy,
                                                               const Eigen::Vector2d& guess) const;

  /// Throws InputError naming `source` unless size and parameters make a usable camera.
  void Check(std::string_view source) const;
};

// ---- implementation of the template ----

namespace internal {

/// By what an equidistant lens scales normalised coordinates of the squared radius r2:
/// theta (1 + k[0] theta^2 + k[1] theta^4 + ...) / r.
template <typename T>
T EquidistantScale(const T& r2, const T* k, int num_terms) {
  using std::atan;
  using std::sqrt;
  if (!(r2 > T(1e-16))) return T(1.0);
  const T r = sqrt(r2);
  const T theta = atan(r);
  const T t2 = theta * theta;
  T sum = k[num_terms - 1];
  for (int i = num_terms - 2; i >= 0; --i) sum = k[i] + t2 * sum;
  return theta * (T(1.0) + t2 * sum) / r;
}

}  // namespace internal

template <typename T>
void ImageFromCamera(CameraModel model, const T* p, const T* xyz, T* xy) {
  using std::atan;
  using std::atan2;
  using std::sqrt;
  using std::tan;
  const T u = xyz[0] / xyz[2];
  const T v = xyz[1] / xyz[2];
  const T r2 = u * u + v * v;
  switch (model) {
    case CameraModel::kSimplePinhole:
      xy[0] = p[0] * u + p[1];
      xy[1] = p[0] * v + p[2];
      return;
    case CameraModel::kPinhole:
      xy[0] = p[0] * u + p[2];
      xy[1] = p[1] * v + p[3];
      return;
    case CameraModel::kSimpleRadial: {
      const T d = T(1.0) + p[3] * r2;
      xy[0] = p[0] * d * u + p[1];
      xy[1] = p[0] * d * v + p[2];
      return;
    }
    case CameraModel::kRadial: {
      const T d = T(1.0) + r2 * (p[3] + p[4] * r2);
      xy[0] = p[0] * d * u + p[1];
      xy[1] = p[0] * d * v + p[2];
      return;
    }
    case CameraModel::kOpenCv:
    case CameraModel::kFullOpenCv: {
      T d = T(1.0) + r2 * (p[4] + p[5] * r2);
      if (model == CameraModel::kFullOpenCv) {
        d = (d + p[8] * r2 * r2 * r2) / (T(1.0) + r2 * (p[9] + r2 * (p[10] + r2 * p[11])));
      }
      const T x = d * u + T(2.0) * p[6] * u * v + p[7] * (r2 + T(2.0) * u * u);
      const T y = d * v + T(2.0) * p[7] * u * v + p[6] * (r2 + T(2.0) * v * v);
      xy[0] = p[0] * x + p[2];
      xy[1] = p[1] * y + p[3];
      return;
    }
    case CameraModel::kOpenCvFisheye: {
      const T scale = internal::EquidistantScale(r2, p + 4, 4);
      xy[0] = p[0] * scale * u + p[2];
      xy[1] = p[1] * scale * v + p[3];
      return;
    }
    case CameraModel::kSimpleRadialFisheye:
    case CameraModel::kRadialFisheye: {
      const int num_terms = model == CameraModel::kRadialFisheye ? 2 : 1;
      const T scale = internal::EquidistantScale(r2, p + 3, num_terms);
      xy[0] = p[0] * scale * u + p[1];
      xy[1] = p[0] * scale * v + p[2];
      return;
    }
    case CameraModel::kFov: {
      // Devernay and Faugeras: r_d = atan(2 r tan(omega/2)) / omega; both limits by series.
      const T omega = p[4];
      T scale;
      if (omega * omega < T(1e-8)) {
        scale = T(1.0) + omega * omega * (T(1.0) / T(12.0) - r2 / T(3.0));
      } else if (r2 * omega * omega < T(1e-12)) {
        const T t = T(2.0) * tan(omega / T(2.0));
        scale = (t - t * t * t * r2 / T(3.0)) / omega;
      } else {
        const T r = sqrt(r2);
        scale = atan(T(2.0) * r * tan(omega / T(2.0))) / (r * omega);
      }
      xy[0] = p[0] * scale * u + p[2];
      xy[1] = p[1] * scale * v + p[3];
      return;
    }
  }
}

}  // namespace s3lam
