#include "s3lam/slam/patch_refiner.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace s3lam {
namespace {

constexpr double kConverged = 0.01;       // Shift of the last step [px of the level].
constexpr double kMinNormalCosine = 0.2;  // Planes seen at a flatter angle are not warped.

/// Bilinear interpolation; the caller has checked the bounds.
float Sample(const cv::Mat& image, double x, double y) {
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

/// A square patch with its gradients and the normal equations of the alignment.
struct Template {
  int half = 0;
  std::vector<float> values;  // side x side
  std::vector<Eigen::Vector2f> gradients;
  Eigen::Matrix3d inverse_hessian;  // Of (x, y, brightness)
  double mean = 0.0;
  double deviation = 0.0;
};

/// Samples the reference at center + warp * offset for offsets of the target's level, one wider on
/// each side for the gradients.
std::optional<Template> MakeTemplate(const cv::Mat& image, const Eigen::Vector2d& center,
                                     const Eigen::Matrix2d& warp, int half) {
  const double reach = (half + 1) * (warp.cwiseAbs().rowwise().sum().maxCoeff());
  if (!IsInside(image, center, reach + 1.0)) return std::nullopt;
  const int wide = 2 * half + 3;
  std::vector<float> samples(static_cast<size_t>(wide * wide));
  for (int v = 0; v < wide; ++v) {
    for (int u = 0; u < wide; ++u) {
      const Eigen::Vector2d at = center + warp * Eigen::Vector2d(u - half - 1, v - half - 1);
      samples[static_cast<size_t>(v * wide + u)] = Sample(image, at.x(), at.y());
    }
  }
  Template patch;
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

/// Zero-mean normalised cross-correlation with the image at a place.
double Correlation(const Template& patch, const cv::Mat& image, const Eigen::Vector2d& center) {
  double sum = 0.0;
  double sum_squared = 0.0;
  double product = 0.0;
  size_t k = 0;
  for (int v = -patch.half; v <= patch.half; ++v) {
    for (int u = -patch.half; u <= patch.half; ++u, ++k) {
      const double value = Sample(image, center.x() + u, center.y() + v);
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

/// Moves `center` until the image there looks like the patch; false if it does not come to rest.
bool AlignTemplate(const Template& patch, const cv::Mat& image, int max_iterations,
                   Eigen::Vector2d& center) {
  double brightness = 0.0;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    if (!IsInside(image, center, patch.half + 1.0)) return false;
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    size_t k = 0;
    for (int v = -patch.half; v <= patch.half; ++v) {
      for (int u = -patch.half; u <= patch.half; ++u, ++k) {
        const double residual =
            Sample(image, center.x() + u, center.y() + v) - patch.values[k] - brightness;
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

}  // namespace

void PatchRefinerOptions::Visit(OptionVisitor& v) {
  v.Value("enabled", enabled, "align the observations of a point with one another");
  v.Value("half_size", half_size, "of the patch, on the keypoint's level [px]", 2, 30);
  v.Value("max_iterations", max_iterations, "of one alignment", 1, 1000);
  v.Value("max_shift", max_shift, "an observation may move so far, on its level [px]", 0.1, 20.0);
  v.Value("min_correlation", min_correlation, "of the aligned patches", -1.0, 1.0);
  v.Value("sigma_px", sigma_px, "standard deviation of an aligned observation, on its level [px]",
          0.01, 10.0);
}

PatchRefiner::PatchRefiner(const PatchRefinerOptions& options,
                           const FeatureOptions& feature_options, const Undistorter& undistorter)
    : options_(options), scale_factor_(feature_options.scale_factor), undistorter_(undistorter) {}

std::optional<Eigen::Matrix2d> PatchRefiner::ReferenceFromTarget(
    const PatchView& reference, const PatchView& target, const Eigen::Vector3d& point,
    const Eigen::Vector3d& view_direction) const {
  const Camera& camera = undistorter_.camera();
  const Rigid3 world_from_target = target.cam_from_world.Inverse();
  const Eigen::Vector3d center = world_from_target.translation;
  // Where a pixel of the target hits the plane, seen in the reference.
  const auto map = [&](const Eigen::Vector2d& pixel) -> std::optional<Eigen::Vector2d> {
    const auto undistorted = undistorter_.Undistort(pixel);
    if (!undistorted) return std::nullopt;
    const Eigen::Vector3d ray = world_from_target.rotation *
                                undistorter_.intrinsics().Normalize(*undistorted).homogeneous();
    const double slope = ray.dot(view_direction);
    if (slope < kMinNormalCosine * ray.norm()) return std::nullopt;
    const double distance = (point - center).dot(view_direction) / slope;
    return camera.ImageFromCamera(reference.cam_from_world * (center + distance * ray));
  };
  const auto projected = camera.ImageFromCamera(target.cam_from_world * point);
  if (!projected) return std::nullopt;
  const double step = options_.half_size * std::pow(scale_factor_, target.level);
  const auto origin = map(*projected);
  const auto right = map(*projected + Eigen::Vector2d(step, 0.0));
  const auto down = map(*projected + Eigen::Vector2d(0.0, step));
  if (!origin || !right || !down) return std::nullopt;
  Eigen::Matrix2d warp;
  warp.col(0) = (*right - *origin) / step;
  warp.col(1) = (*down - *origin) / step;
  const double area = warp.determinant();
  if (!(area > 0.05) || area > 20.0) return std::nullopt;
  return warp;
}

std::optional<Eigen::Vector2d> PatchRefiner::Align(const PatchView& reference,
                                                   const PatchView& target,
                                                   const Eigen::Vector3d& point,
                                                   const Eigen::Vector3d& view_direction) const {
  const auto warp = ReferenceFromTarget(reference, target, point, view_direction);
  if (!warp) return std::nullopt;
  // Sample the reference on the level on which one step of the target's level is about one pixel.
  const double target_scale = std::pow(scale_factor_, target.level);
  const double step = target_scale * std::sqrt(warp->determinant());
  const int top = static_cast<int>(reference.pyramid->levels.size()) - 1;
  const int level =
      std::clamp(static_cast<int>(std::lround(std::log(step) / std::log(scale_factor_))), 0, top);
  const double reference_scale = std::pow(scale_factor_, level);
  const auto patch = MakeTemplate(reference.pyramid->levels[level],
                                  reference.pyramid->ToLevel(reference.pixel, level),
                                  *warp * (target_scale / reference_scale), options_.half_size);
  if (!patch) return std::nullopt;
  const cv::Mat& image = target.pyramid->levels[target.level];
  const Eigen::Vector2d start = target.pyramid->ToLevel(target.pixel, target.level);
  Eigen::Vector2d center = start;
  if (!AlignTemplate(*patch, image, options_.max_iterations, center)) return std::nullopt;
  if ((center - start).norm() > options_.max_shift) return std::nullopt;
  if (Correlation(*patch, image, center) < options_.min_correlation) return std::nullopt;
  return target.pyramid->FromLevel(center, target.level);
}

}  // namespace s3lam
