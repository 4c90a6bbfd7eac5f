#include "patch_template.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace s3lam {
namespace {

constexpr double kConverged = 0.01;    // Shift of the last step [px of the level].
constexpr float kMinDeviation = 2.0F;  // Of the values [grey levels].
constexpr float kNoDeviation = 1e-3F;
constexpr double kMinSquaredGradient = 100.0;  // Determinant of the gradients' sums, per sample.

/// Bilinear interpolation [grey levels]; (x, y) must be inside by one pixel.
float SampleImage(const cv::Mat& image, float x, float y) {
  const int x0 = static_cast<int>(x);
  const int y0 = static_cast<int>(y);
  const float fx = x - static_cast<float>(x0);
  const float fy = y - static_cast<float>(y0);
  const uchar* top = image.ptr<uchar>(y0) + x0;
  const uchar* bottom = image.ptr<uchar>(y0 + 1) + x0;
  const float a = static_cast<float>(top[0]) * (1.0F - fx) + static_cast<float>(top[1]) * fx;
  const float b = static_cast<float>(bottom[0]) * (1.0F - fx) + static_cast<float>(bottom[1]) * fx;
  return a * (1.0F - fy) + b * fy;
}

float Deviation(const Eigen::VectorXf& values, float mean) {
  return std::sqrt((values.array() - mean).square().mean());
}

}  // namespace

bool IsInside(const cv::Mat& image, const Eigen::Vector2d& xy, double margin) {
  return xy.x() >= margin && xy.y() >= margin && xy.x() < image.cols - 1 - margin &&
         xy.y() < image.rows - 1 - margin;
}

void SamplePatch(const cv::Mat& image, const Eigen::Vector2d& center, int half,
                 Eigen::VectorXf& values) {
  const int side = 2 * half + 1;
  const int x0 = static_cast<int>(center.x()) - half;
  const int y0 = static_cast<int>(center.y()) - half;
  const auto fx = static_cast<float>(center.x() - (x0 + half));
  const auto fy = static_cast<float>(center.y() - (y0 + half));
  const float top_left = (1.0F - fx) * (1.0F - fy);
  const float top_right = fx * (1.0F - fy);
  const float bottom_left = (1.0F - fx) * fy;
  const float bottom_right = fx * fy;
  values.resize(side * side);
  for (int v = 0; v < side; ++v) {
    const uchar* top = image.ptr<uchar>(y0 + v) + x0;
    const uchar* bottom = image.ptr<uchar>(y0 + v + 1) + x0;
    float* row = values.data() + static_cast<ptrdiff_t>(v) * side;
    for (int u = 0; u < side; ++u) {
      row[u] = top_left * static_cast<float>(top[u]) + top_right * static_cast<float>(top[u + 1]) +
               bottom_left * static_cast<float>(bottom[u]) +
               bottom_right * static_cast<float>(bottom[u + 1]);
    }
  }
}

std::optional<PatchTemplate> MakePatchTemplate(const cv::Mat& image, const Eigen::Vector2d& center,
                                               const PatchWarp& warp, int half) {
  // One wider on each side for the gradients.
  const int end = half + 1;
  const Eigen::Vector2d second = warp.uu.cwiseAbs() + warp.uv.cwiseAbs() + warp.vv.cwiseAbs();
  const double reach = end * (warp.linear.cwiseAbs().rowwise().sum() + end * second).maxCoeff();
  if (!IsInside(image, center, reach + 1.0)) return std::nullopt;
  const int side = 2 * half + 1;
  const int wide = side + 2;
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> samples(wide, wide);
  const Eigen::Matrix2f linear = warp.linear.cast<float>();
  const Eigen::Vector2f uu = warp.uu.cast<float>();
  const Eigen::Vector2f uv = warp.uv.cast<float>();
  const Eigen::Vector2f vv = warp.vv.cast<float>();
  for (int j = 0; j < wide; ++j) {
    const auto v = static_cast<float>(j - end);
    const Eigen::Vector2f row = center.cast<float>() + v * (linear.col(1) + v * vv);
    const Eigen::Vector2f slope = linear.col(0) + v * uv;
    for (int i = 0; i < wide; ++i) {
      const auto u = static_cast<float>(i - end);
      const Eigen::Vector2f at = row + u * (slope + u * uu);
      samples(j, i) = SampleImage(image, at.x(), at.y());
    }
  }
  PatchTemplate patch;
  patch.half = half;
  patch.values.resize(side * side);
  patch.jacobian.resize(side * side, 3);
  for (int v = 0; v < side; ++v) {
    const auto row = Eigen::seqN(v * side, side);
    patch.values(row) = samples.row(v + 1).segment(1, side);
    patch.jacobian(row, 0) =
        0.5F * (samples.row(v + 1).segment(2, side) - samples.row(v + 1).segment(0, side));
    patch.jacobian(row, 1) =
        0.5F * (samples.row(v + 2).segment(1, side) - samples.row(v).segment(1, side));
  }
  patch.jacobian.col(2).setOnes();
  patch.mean = patch.values.mean();
  patch.deviation = Deviation(patch.values, patch.mean);
  const Eigen::Matrix3d hessian =
      (patch.jacobian.transpose() * patch.jacobian).eval().cast<double>();
  // A patch without texture in some direction cannot be located.
  if (patch.deviation < kMinDeviation ||
      hessian.topLeftCorner<2, 2>().determinant() <
          kMinSquaredGradient * static_cast<double>(patch.values.size())) {
    return std::nullopt;
  }
  patch.inverse_hessian = hessian.inverse();
  if (!patch.inverse_hessian.allFinite()) return std::nullopt;
  return patch;
}

void PatchResidual(const PatchTemplate& patch, const cv::Mat& image, const Eigen::Vector2d& center,
                   float brightness, Eigen::VectorXf& residual) {
  SamplePatch(image, center, patch.half, residual);
  const float mean = residual.mean();
  const float deviation = Deviation(residual, mean);
  const float contrast = deviation > kNoDeviation ? patch.deviation / deviation : 1.0F;
  residual.array() =
      contrast * (residual.array() - mean) + (mean - brightness) - patch.values.array();
}

double PatchCorrelation(const PatchTemplate& patch, const cv::Mat& image,
                        const Eigen::Vector2d& center) {
  Eigen::VectorXf values;
  SamplePatch(image, center, patch.half, values);
  const float mean = values.mean();
  const float deviation = Deviation(values, mean);
  if (deviation < kNoDeviation) return 0.0;
  const float product =
      (values.array() - mean).matrix().dot(patch.values) / static_cast<float>(patch.values.size());
  return product / (deviation * patch.deviation);
}

bool AlignPatch(const PatchTemplate& patch, const cv::Mat& image, int max_iterations,
                Eigen::Vector2d& center) {
  Eigen::VectorXf residual;
  float brightness = 0.0F;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    if (!IsInside(image, center, patch.half + 1.0)) return false;
    PatchResidual(patch, image, center, brightness, residual);
    const Eigen::Vector3f right = patch.jacobian.transpose() * residual;
    const Eigen::Vector3d step = patch.inverse_hessian * right.cast<double>();
    center -= step.head<2>();
    brightness += static_cast<float>(step.z());
    if (step.head<2>().norm() < kConverged) return IsInside(image, center, patch.half + 1.0);
  }
  return false;
}

}  // namespace s3lam
