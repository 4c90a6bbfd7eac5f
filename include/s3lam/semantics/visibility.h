#pragma once

#include <map>
#include <utility>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/scene/reconstruction.h"

namespace s3lam {

struct VisibilityOptions {
  bool predict = true;
  double max_view_angle_deg = 8.0;
  double max_depth_ratio = 1.3;
  int max_neighbors = 40;

  void Visit(OptionVisitor& v);
};

/// Predicts which points an image shows besides those it observes. A track holds only the images in
/// which a keypoint was matched; an image taken from nearly the same place sees the same surface,
/// unless something small stands in between.
class VisibilityPredictor {
 public:
  VisibilityPredictor(const Reconstruction& reconstruction, const VisibilityOptions& options);

  struct Prediction {
    PointId point_id;
    Eigen::Vector2d xy = Eigen::Vector2d::Zero();  // px in the image
  };

  /// Points that the image does not observe, but an image nearby does at nearly the same angle and
  /// depth, and that project into it. By ascending id.
  [[nodiscard]] std::vector<Prediction> Predict(const Image& image) const;

 private:
  const Reconstruction& reconstruction_;
  VisibilityOptions options_;
  std::map<ImageId, std::vector<const Image*>> neighbors_;
};

}  // namespace s3lam
