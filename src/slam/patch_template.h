#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

namespace s3lam {

/// A square patch with its gradients and the normal equations of the alignment.
struct PatchTemplate {
  int half = 0;
  std::vector<float> values;  // side x side
  std::vector<Eigen::Vector2f> gradients;
  Eigen::Matrix3d inverse_hessian;  // Of (x, y, brightness)
  double mean = 0.0;
  double deviation = 0.0;
};

/// Bilinear interpolation [grey levels]; `xy` must be inside by one pixel.
float SampleImage(const cv::Mat& image, double x, double y);

/// Is `xy` [px] at least `margin` from all edges, with room for interpolation?
bool IsInside(const cv::Mat& image, const Eigen::Vector2d& xy, double margin);

/// Samples an image at center + warp * offset for offsets of the target's level, (2 half + 1)^2 of
/// them. Empty at the image's edge and without texture.
std::optional<PatchTemplate> MakePatchTemplate(const cv::Mat& image, const Eigen::Vector2d& center,
                                               const Eigen::Matrix2d& warp, int half);

/// Zero-mean normalised cross-correlation with the image at a place.
double PatchCorrelation(const PatchTemplate& patch, const cv::Mat& image,
                        const Eigen::Vector2d& center);

/// Moves `center` until the image there looks like the patch; false if it does not come to rest.
bool AlignPatch(const PatchTemplate& patch, const cv::Mat& image, int max_iterations,
                Eigen::Vector2d& center);

}  // namespace s3lam
