#include "s3lam/slam/patch_refiner.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "patch_template.h"

namespace s3lam {
namespace {

constexpr double kMinNormalCosine = 0.05;  // Planes seen at a flatter angle are not warped.

/// Of the rays from the point's pixel, in steps.
const std::array<Eigen::Vector2d, 6> kOffsets{
    Eigen::Vector2d(0.0, 0.0), Eigen::Vector2d(1.0, 0.0),  Eigen::Vector2d(-1.0, 0.0),
    Eigen::Vector2d(0.0, 1.0), Eigen::Vector2d(0.0, -1.0), Eigen::Vector2d(1.0, 1.0)};

/// The quadratic map through what is seen at kOffsets times a step.
PatchWarp WarpThrough(const std::array<Eigen::Vector2d, 6>& seen, double step) {
  const auto& [center, right, left, below, above, corner] = seen;
  PatchWarp warp;
  warp.linear.col(0) = (right - left) / (2.0 * step);
  warp.linear.col(1) = (below - above) / (2.0 * step);
  const double squared = step * step;
  warp.uu = (right + left - 2.0 * center) / (2.0 * squared);
  warp.vv = (below + above - 2.0 * center) / (2.0 * squared);
  warp.uv = (corner - center - warp.linear * Eigen::Vector2d::Constant(step)) / squared - warp.uu -
            warp.vv;
  return warp;
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

std::optional<PatchRefiner::TargetRays> PatchRefiner::RaysOf(const PatchView& target,
                                                             const Eigen::Vector3d& point) const {
  const auto projected = undistorter_.camera().ImageFromCamera(target.cam_from_world * point);
  if (!projected) return std::nullopt;
  const Rigid3 world_from_target = target.cam_from_world.Inverse();
  TargetRays rays;
  rays.center_in_world = world_from_target.translation;
  rays.step = options_.half_size * std::pow(scale_factor_, target.level);
  for (size_t i = 0; i < kOffsets.size(); ++i) {
    const auto undistorted = undistorter_.Undistort(*projected + rays.step * kOffsets[i]);
    if (!undistorted) return std::nullopt;
    rays.rays_in_world[i] = world_from_target.rotation *
                            undistorter_.intrinsics().Normalize(*undistorted).homogeneous();
  }
  return rays;
}

std::optional<PatchWarp> PatchRefiner::ReferenceFromTarget(const PatchView& reference,
                                                           const TargetRays& target,
                                                           const Eigen::Vector3d& point,
                                                           const Eigen::Vector3d& normal) const {
  const double plane_distance = (point - target.center_in_world).dot(normal);
  std::array<Eigen::Vector2d, 6> seen;
  for (size_t i = 0; i < seen.size(); ++i) {
    const Eigen::Vector3d& ray = target.rays_in_world[i];
    const double slope = ray.dot(normal);
    if (slope < kMinNormalCosine * ray.norm()) return std::nullopt;
    const auto pixel = undistorter_.camera().ImageFromCamera(
        reference.cam_from_world * (target.center_in_world + plane_distance / slope * ray));
    if (!pixel) return std::nullopt;
    seen[i] = *pixel;
  }
  const PatchWarp warp = WarpThrough(seen, target.step);
  const double area = warp.linear.determinant();
  if (!(area > 0.05) || area > 20.0) return std::nullopt;
  return warp;
}

std::optional<PatchTemplate> PatchRefiner::WarpedPatch(const PatchView& reference, int target_level,
                                                       const PatchWarp& warp) const {
  // Sample the reference on the level on which one step of the target's level is about one pixel.
  const double target_scale = std::pow(scale_factor_, target_level);
  const double step = target_scale * std::sqrt(warp.linear.determinant());
  const int top = static_cast<int>(reference.pyramid->levels.size()) - 1;
  const int level =
      std::clamp(static_cast<int>(std::lround(std::log(step) / std::log(scale_factor_))), 0, top);
  const double reference_scale = std::pow(scale_factor_, level);
  return MakePatchTemplate(reference.pyramid->levels[level],
                           reference.pyramid->ToLevel(reference.pixel, level),
                           warp.Scaled(target_scale, reference_scale), options_.half_size);
}

std::optional<Eigen::Vector2d> PatchRefiner::Align(const PatchView& reference,
                                                   const PatchView& target,
                                                   const Eigen::Vector3d& point,
                                                   const Eigen::Vector3d& normal) const {
  const auto rays = RaysOf(target, point);
  const auto warp = rays ? ReferenceFromTarget(reference, *rays, point, normal) : std::nullopt;
  if (!warp) return std::nullopt;
  const auto patch = WarpedPatch(reference, target.level, *warp);
  if (!patch) return std::nullopt;
  const cv::Mat& image = target.pyramid->levels[target.level];
  const Eigen::Vector2d start = target.pyramid->ToLevel(target.pixel, target.level);
  Eigen::Vector2d center = start;
  if (!AlignPatch(*patch, image, options_.max_iterations, center)) return std::nullopt;
  if ((center - start).norm() > options_.max_shift) return std::nullopt;
  if (PatchCorrelation(*patch, image, center) < options_.min_correlation) return std::nullopt;
  return target.pyramid->FromLevel(center, target.level);
}

}  // namespace s3lam
