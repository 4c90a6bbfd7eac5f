#include "patch_template.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace s3lam {
namespace {

constexpr double kConverged = 0.01;  // Shift of the last step [px of the level].

}  // namespace

float SampleImage(const cv::Mat& image, double x, double y) {
  const int x0 = static_cast<int>(x);
  const int y0 = static_cast<int>(y);
  const auto fx = static_cast<float>(x - x0);
  const auto fy = static_cast<float>(y - y0);
  const uchar* top = image.ptr<uchar>(y0) + x0;
  const uchar* bottom = image.ptr<uchar>(y0 + 1) + x0;
  const float a = static_cast<float>(top[0]) * (1.0F - fx) + static_cast<float>(top[1]) * fx;
  const float b = static_cast<float>(bottom[0]) * (1.0F - fx) + static_cast<float>(bottom[1]) * fx;
  return a * (1.0F - fy) + b * fy;
}

bool IsInside(const cv::Mat& image, const Eigen::Vector2d& xy, double margin) {
  return xy.x() >= margin && xy.y() >= margin && xy.x() < image.cols - 1 - margin &&
         xy.y() < image.rows - 1 - margin;
}

std::optional<PatchTemplate> MakePatchTemplate(const cv::Mat& image, const Eigen::Vector2d& center,
                                               const Eigen::Matrix2d& warp, int half) {
  // One wider on each side for the gradients.
  const double reach = (half + 1) * (warp.cwiseAbs().rowwise().sum().maxCoeff());
  if (!IsInside(image, center, reach + 1.0)) return std::nullopt;
  const int wide = 2 * half + 3;
  std::vector<float> samples(static_cast<size_t>(wide * wide));
  for (int v = 0; v < wide; ++v) {
    for (int u = 0; u < wide; ++u) {
      const Eigen::Vector2d at = center + warp * Eigen::Vector2d(u - half - 1, v - half - 1);
      samples[static_cast<size_t>(v * wide + u)] = SampleImage(image, at.x(), at.y());
    }
  }
  PatchTemplate patch;
  patch.half = half;
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  double sum = 0.0;
  double sum_squared = 0.0;
  for (int v = 1; v + 1 < wide; ++v) {
    for (int u = 1; u + 1 < wide; ++u) {
      const auto at = [&](int x, int y) { return samples[static_cast<size_t>(y * wide + x)]; };
      const Eigen::Vector2f gradient(0.5F * (at(u + 1, v) - at(u - 1, v)),
                                     0.5F * (at(u, v + 1) - at(u, v - 1)));
      const double value = at(u, v);
      patch.values.push_back(at(u, v));
      patch.gradients.push_back(gradient);
      const Eigen::Vector3d jacobian(gradient.x(), gradient.y(), 1.0);
      hessian += jacobian * jacobian.transpose();
      sum += value;
      sum_squared += value * value;
    }
  }
  const auto n = static_cast<double>(patch.values.size());
  patch.mean = sum / n;
  patch.deviation = std::sqrt(std::max(0.0, sum_squared / n - patch.mean * patch.mean));
  // A patch without texture in some direction cannot be located.
  if (patch.deviation < 2.0 || hessian.topLeftCorner<2, 2>().determinant() < 1e2 * n) {
    return std::nullopt;
  }
  patch.inverse_hessian = hessian.inverse();
  if (!patch.inverse_hessian.allFinite()) return std::nullopt;
  return patch;
}

double PatchCorrelation(const PatchTemplate& patch, const cv::Mat& image,
                        const Eigen::Vector2d& center) {
  double sum = 0.0;
  double sum_squared = 0.0;
  double product = 0.0;
  size_t k = 0;
  for (int v = -patch.half; v <= patch.half; ++v) {
    for (int u = -patch.half; u <= patch.half; ++u, ++k) {
      const double value = SampleImage(image, center.x() + u, center.y() + v);
      sum += value;
      sum_squared += value * value;
      product += value * patch.values[k];
    }
  }
  const auto n = static_cast<double>(patch.values.size());
  const double mean = sum / n;
  const double deviation = std::sqrt(std::max(0.0, sum_squared / n - mean * mean));
  if (deviation < 1e-6) return 0.0;
  return (product / n - mean * patch.mean) / (deviation * patch.deviation);
}

bool AlignPatch(const PatchTemplate& patch, const cv::Mat& image, int max_iterations,
                Eigen::Vector2d& center) {
  double brightness = 0.0;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    if (!IsInside(image, center, patch.half + 1.0)) return false;
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    size_t k = 0;
    for (int v = -patch.half; v <= patch.half; ++v) {
      for (int u = -patch.half; u <= patch.half; ++u, ++k) {
        const double residual =
            SampleImage(image, center.x() + u, center.y() + v) - patch.values[k] - brightness;
        right += residual * Eigen::Vector3d(patch.gradients[k].x(), patch.gradients[k].y(), 1.0);
      }
    }
    const Eigen::Vector3d step = patch.inverse_hessian * right;
    center -= step.head<2>();
    brightness += step.z();
    if (step.head<2>().norm() < kConverged) return IsInside(image, center, patch.half + 1.0);
  }
  return false;
}

}  // namespace s3lam
