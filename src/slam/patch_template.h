#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>

namespace s3lam {

/// A square patch with its gradients and the normal equations of the alignment.
struct PatchTemplate {
  int half = 0;
  Eigen::VectorXf values;     // side x side, by rows
  Eigen::MatrixX3f jacobian;  // Of the values: gradient along x and y, 1 for the brightness
  Eigen::Matrix3d inverse_hessian;
  float mean = 0.0F;
  float deviation = 0.0F;
};

/// Where an image shows what another one shows at an offset (u, v) from a place:
/// linear (u, v) + uu u^2 + uv u v + vv v^2.
struct PatchWarp {
  Eigen::Matrix2d linear = Eigen::Matrix2d::Identity();
  Eigen::Vector2d uu = Eigen::Vector2d::Zero();
  Eigen::Vector2d uv = Eigen::Vector2d::Zero();
  Eigen::Vector2d vv = Eigen::Vector2d::Zero();

  /// For offsets in pixels `from` times as large, into ones `to` times as large.
  [[nodiscard]] PatchWarp Scaled(double from, double to) const {
    const double second = from * from / to;
    return {linear * (from / to), uu * second, uv * second, vv * second};
  }
};

/// Is `xy` [px] at least `margin` from all edges, with room for interpolation?
bool IsInside(const cv::Mat& image, const Eigen::Vector2d& xy, double margin);

/// The (2 half + 1)^2 values [grey levels] around a place by rows, by bilinear interpolation; the
/// place must be inside by half + 1 pixels.
void SamplePatch(const cv::Mat& image, const Eigen::Vector2d& center, int half,
                 Eigen::VectorXf& values);

/// Samples an image around a place where `warp` brings offsets of the target's level, (2 half +
/// 1)^2 of them. Empty at the image's edge and without texture.
std::optional<PatchTemplate> MakePatchTemplate(const cv::Mat& image, const Eigen::Vector2d& center,
                                               const PatchWarp& warp, int half);

/// What an image at a place differs from the patch by [grey levels], once it has the patch's
/// contrast and `brightness` is taken off: exposure and shading change both.
void PatchResidual(const PatchTemplate& patch, const cv::Mat& image, const Eigen::Vector2d& center,
                   float brightness, Eigen::VectorXf& residual);

/// Zero-mean normalised cross-correlation with the image at a place.
double PatchCorrelation(const PatchTemplate& patch, const cv::Mat& image,
                        const Eigen::Vector2d& center);

/// Moves `center` until the image there looks like the patch; false if it does not come to rest.
bool AlignPatch(const PatchTemplate& patch, const cv::Mat& image, int max_iterations,
                Eigen::Vector2d& center);

}  // namespace s3lam
