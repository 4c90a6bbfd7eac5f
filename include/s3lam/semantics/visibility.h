#pragma once

#include <cstdint>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/semantics/point_rows.h"

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
  /// Keeps references to the reconstruction and to its rows.
  VisibilityPredictor(const Reconstruction& reconstruction, const PointRows& rows,
                      const VisibilityOptions& options);

  struct Prediction {
    uint32_t row = 0;
    Eigen::Vector2d xy = Eigen::Vector2d::Zero();  // px in the image
  };

  /// Points that the image does not observe, but an image nearby does at nearly the same angle and
  /// depth, and that project into it. By ascending row.
  [[nodiscard]] std::vector<Prediction> Predict(const Image& image) const;

 private:
  struct View {
    const Image* image = nullptr;
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    std::vector<uint32_t> points;     // Rows it observes, ascending.
    std::vector<uint32_t> neighbors;  // Views, nearest first.
  };

  /// True if both see the point at nearly the same angle and depth.
  [[nodiscard]] bool SeeAlike(const View& a, const View& b, uint32_t row) const;
  [[nodiscard]] std::vector<View> MakeViews() const;

  const Reconstruction& reconstruction_;
  const PointRows& rows_;
  VisibilityOptions options_;
  double min_cosine_ = 0.0;
  std::vector<Eigen::Vector3d> xyz_;  // Of each row.
  std::vector<View> views_;           // By image id; empty if nothing is to be predicted.
};

}  // namespace s3lam
