#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>
#include <vector>

#include "s3lam/slam/map.h"

namespace s3lam {

struct PatchRefinerOptions {
  bool enabled = true;
  int half_size = 5;
  int max_iterations = 12;
  double max_shift = 2.0;
  double min_correlation = 0.8;
  double sigma_px = 0.4;

  void Visit(OptionVisitor& v);
};

class NormalEstimator;
struct PatchTemplate;
struct PatchWarp;

/// What a patch alignment needs to know of one observation.
struct PatchView {
  const ImagePyramid* pyramid = nullptr;
  Rigid3 cam_from_world;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // px in the original image
  int level = 0;
};

/// Finds observations to a fraction of a pixel: the patch around one observation of a point, warped
/// as a small plane through the point would look from there (to second order), is aligned with the
/// image of another (Gauss-Newton on the shift and a brightness offset, inverse compositional:
/// Baker and Matthews 2004; contrast is compared by the correlation). Where the plane is not the
/// surface's, places drift along a track as the view gets more or less oblique, which moves the
/// point off the surface.
class PatchRefiner {
 public:
  PatchRefiner(const PatchRefinerOptions& options, const FeatureOptions& feature_options,
               const Undistorter& undistorter);

  /// Unit normal [world, away from the cameras] of the surface around a point: the one for which
  /// its patches in the targets (those seen under the largest angle to the reference count most:
  /// give these) look most like the reference's, by Gauss-Newton on two slopes and a shift and
  /// brightness per target. `facing` is where it starts and what it keeps to without evidence.
  [[nodiscard]] Eigen::Vector3d EstimateNormal(const PatchView& reference,
                                               std::span<const PatchView> targets,
                                               const Eigen::Vector3d& point,
                                               const Eigen::Vector3d& facing) const;

  /// Pixel in `target` that shows what `reference` shows at its pixel; starts from target.pixel.
  /// `normal` is the surface's at the point [world, away from the cameras]. Empty if the alignment
  /// leaves the image, moves too far, does not converge or the patches differ.
  [[nodiscard]] std::optional<Eigen::Vector2d> Align(const PatchView& reference,
                                                     const PatchView& target,
                                                     const Eigen::Vector3d& point,
                                                     const Eigen::Vector3d& normal) const;

 private:
  friend class NormalEstimator;

  /// Rays of a target through the point's pixel and others `step` pixels around it (kOffsets).
  struct TargetRays {
    Eigen::Vector3d center_in_world;
    std::array<Eigen::Vector3d, 6> rays_in_world;
    double step = 0.0;  // px
  };

  [[nodiscard]] std::optional<TargetRays> RaysOf(const PatchView& target,
                                                 const Eigen::Vector3d& point) const;
  /// Offsets in the reference by those in the target [px]; empty where the plane is not seen.
  [[nodiscard]] std::optional<PatchWarp> ReferenceFromTarget(const PatchView& reference,
                                                             const TargetRays& target,
                                                             const Eigen::Vector3d& point,
                                                             const Eigen::Vector3d& normal) const;
  /// The reference's patch as it looks in a target on one of its levels.
  [[nodiscard]] std::optional<PatchTemplate> WarpedPatch(const PatchView& reference,
                                                         int target_level,
                                                         const PatchWarp& warp) const;

  const PatchRefinerOptions& options_;
  double scale_factor_;
  const Undistorter& undistorter_;
};

/// What refining a map did.
struct PatchRefinement {
  int num_tried = 0;
  int num_refined = 0;
};

}  // namespace s3lam
