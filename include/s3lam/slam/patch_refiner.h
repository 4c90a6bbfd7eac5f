#pragma once

#include <Eigen/Core>
#include <optional>
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

/// What a patch alignment needs to know of one observation.
struct PatchView {
  const ImagePyramid* pyramid = nullptr;
  Rigid3 cam_from_world;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // px in the original image
  int level = 0;
};

/// Finds observations to a fraction of a pixel: the patch around one observation of a point, warped
/// by the affine map that a small plane facing the cameras gives, is aligned with the image of
/// another (Gauss-Newton on the shift and a brightness offset, inverse compositional: Baker and
/// Matthews 2004; contrast is compared by the correlation).
class PatchRefiner {
 public:
  PatchRefiner(const PatchRefinerOptions& options, const FeatureOptions& feature_options,
               const Undistorter& undistorter);

  /// Pixel in `target` that shows what `reference` shows at its pixel; starts from target.pixel.
  /// Empty if the alignment leaves the image, moves too far, does not converge or the patches
  /// differ.
  [[nodiscard]] std::optional<Eigen::Vector2d> Align(const PatchView& reference,
                                                     const PatchView& target,
                                                     const Eigen::Vector3d& point,
                                                     const Eigen::Vector3d& view_direction) const;

 private:
  /// d(reference pixel) / d(target pixel); empty where the plane is not seen.
  [[nodiscard]] std::optional<Eigen::Matrix2d> ReferenceFromTarget(
      const PatchView& reference, const PatchView& target, const Eigen::Vector3d& point,
      const Eigen::Vector3d& view_direction) const;

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
