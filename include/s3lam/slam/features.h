#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/geometry/camera.h"
#include "s3lam/optim/bundle_adjustment.h"
#include "s3lam/scene/descriptor.h"

namespace s3lam {

struct FeatureOptions {
  int num_features = 1000;
  int num_levels = 8;
  double scale_factor = 1.2;
  int fast_threshold = 20;
  int min_fast_threshold = 7;

  void Visit(OptionVisitor& v);
};

/// One ORB keypoint.
struct Keypoint {
  Eigen::Vector2f pixel;        // px in the original image, centre of the first pixel at 0.5
  Eigen::Vector2f undistorted;  // px in the undistorted camera
  float angle = 0.0F;           // rad
  float sigma = 1.0F;           // Standard deviation of the position, both axes [px]
  uint8_t level = 0;            // Of the image pyramid, 0 is the full image.

  template <typename A>
  void Transfer(A& archive) {
    archive(pixel, undistorted, angle, sigma, level);
  }
};

/// Maps pixels of a distorted camera to an undistorted one with the same focal lengths and
/// principal point. Holds a coarse table of starting values, so that a pixel takes one or two
/// Newton steps.
class Undistorter {
 public:
  explicit Undistorter(const Camera& camera);

  [[nodiscard]] const PinholeIntrinsics& intrinsics() const { return intrinsics_; }
  [[nodiscard]] const Camera& camera() const { return camera_; }
  /// Bounding box of the undistorted image [px], of wide ones of what is up to 80 degrees off the
  /// axis.
  [[nodiscard]] const Eigen::Vector2d& lower() const { return lower_; }
  [[nodiscard]] const Eigen::Vector2d& upper() const { return upper_; }
  /// Cell of a grid of columns x rows over the undistorted image, row by row; the nearest one for
  /// what lies outside. Of wide lenses, most of whose undistorted image is what little they see
  /// near their border, over the original image.
  [[nodiscard]] size_t CellOf(const Keypoint& keypoint, int columns, int rows) const;
  /// Empty where the distortion cannot be inverted.
  [[nodiscard]] std::optional<Eigen::Vector2d> Undistort(const Eigen::Vector2d& pixel) const;

 private:
  void FindBounds();
  [[nodiscard]] size_t TableIndex(int column, int row) const {
    return static_cast<size_t>(row) * static_cast<size_t>(columns_) + static_cast<size_t>(column);
  }

  Camera camera_;
  PinholeIntrinsics intrinsics_;
  Eigen::Vector2d lower_;
  Eigen::Vector2d upper_;
  bool is_wide_ = false;
  int columns_ = 0;
  int rows_ = 0;
  std::vector<Eigen::Vector2d> table_;  // Normalised coordinates at the corners of the cells.
};

/// Keypoints of one image, and a grid to find them by place.
class FrameFeatures {
 public:
  FrameFeatures() = default;
  FrameFeatures(std::vector<Keypoint> keypoints, std::vector<BinaryDescriptor> descriptors,
                const Undistorter& undistorter);

  [[nodiscard]] int size() const { return static_cast<int>(keypoints_.size()); }
  /// The first so many were detected in the image; the others were added, see Add.
  [[nodiscard]] int num_detected() const { return num_detected_; }
  [[nodiscard]] const Keypoint& keypoint(int i) const { return keypoints_[i]; }
  [[nodiscard]] const BinaryDescriptor& descriptor(int i) const { return descriptors_[i]; }
  /// Whether no further keypoint can be added.
  [[nodiscard]] bool IsFull() const { return keypoints_.size() >= kMaxKeypoints; }
  /// Appends a keypoint and returns its index; BuildGrid makes it visible to VisitNear.
  int Add(const Keypoint& keypoint, const BinaryDescriptor& descriptor);
  void BuildGrid(const Undistorter& undistorter);
  /// Undistorts all keypoints anew, for a camera that was refined.
  void Undistort(const Undistorter& undistorter);
  /// Corrects a keypoint's place; the grid stays as it is: not for VisitNear, but by a fraction of
  /// a pixel.
  void Move(int i, const Eigen::Vector2d& pixel, const Eigen::Vector2d& undistorted, double sigma);
  void SetSigma(int i, double sigma) { keypoints_[i].sigma = static_cast<float>(sigma); }

  template <typename A>
  void Transfer(A& archive) {
    archive(num_detected_, keypoints_, descriptors_, lower_, cells_per_px_, cell_begin_,
            cell_members_);
  }

  /// Calls visit(i) for the keypoints whose undistorted position is within `radius` px of `center`
  /// (a square) and whose level is in [min_level, max_level].
  template <typename Visitor>
  void VisitNear(const Eigen::Vector2d& center, double radius, int min_level, int max_level,
                 Visitor&& visit) const;

 private:
  static constexpr size_t kMaxKeypoints = std::numeric_limits<uint16_t>::max();
  static constexpr int kColumns = 64;
  static constexpr int kRows = 48;

  [[nodiscard]] int Column(double x) const;
  [[nodiscard]] int Row(double y) const;

  int num_detected_ = 0;
  std::vector<Keypoint> keypoints_;
  std::vector<BinaryDescriptor> descriptors_;
  Eigen::Vector2f lower_ = Eigen::Vector2f::Zero();
  Eigen::Vector2f cells_per_px_ = Eigen::Vector2f::Ones();
  std::vector<uint16_t> cell_begin_;    // One more entry than cells, row-major.
  std::vector<uint16_t> cell_members_;  // Keypoints by cell.
};

/// An image at all scales; fewer levels than asked for where the image is too small.
struct ImagePyramid {
  std::vector<cv::Mat> levels;          // 8-bit gray, level 0 is the image itself
  std::vector<Eigen::Vector2d> scales;  // Full image px per level px, along x and y

  /// Coordinates on a level (centre of the first pixel at 0) of a full image's pixel (at 0.5).
  [[nodiscard]] Eigen::Vector2d ToLevel(const Eigen::Vector2d& pixel, int level) const {
    return pixel.cwiseQuotient(scales[level]).array() - 0.5;
  }
  [[nodiscard]] Eigen::Vector2d FromLevel(const Eigen::Vector2d& xy, int level) const {
    return (xy.array() + 0.5).matrix().cwiseProduct(scales[level]);
  }
};
ImagePyramid BuildPyramid(const FeatureOptions& options, const cv::Mat& gray);

/// Whether a place [px, the first pixel's centre at 0.5] must not be used: the mask is zero there.
/// An empty mask leaves everything.
bool IsMasked(const cv::Mat& mask, const Eigen::Vector2d& pixel);

/// ORB keypoints of an 8-bit gray image, spread evenly over image and scale: FAST corners with a
/// second, lower threshold where a cell has none, thinned by a quadtree to the strongest of each
/// node. `mask` (may be empty): keypoints only where it is not zero.
FrameFeatures ExtractFeatures(const FeatureOptions& options, const Undistorter& undistorter,
                              const cv::Mat& gray, const cv::Mat& mask = {});

/// Standard deviation of a keypoint's position [px]: one pixel of its pyramid level.
std::vector<double> LevelSigmas(const FeatureOptions& options);

// ---- implementation of the template ----

template <typename Visitor>
void FrameFeatures::VisitNear(const Eigen::Vector2d& center, double radius, int min_level,
                              int max_level, Visitor&& visit) const {
  if (keypoints_.empty()) return;
  const int first_column = Column(center.x() - radius);
  const int last_column = Column(center.x() + radius);
  const int last_row = Row(center.y() + radius);
  const auto cx = static_cast<float>(center.x());
  const auto cy = static_cast<float>(center.y());
  const auto r = static_cast<float>(radius);
  for (int row = Row(center.y() - radius); row <= last_row; ++row) {
    const size_t begin = cell_begin_[static_cast<size_t>(row * kColumns + first_column)];
    const size_t end = cell_begin_[static_cast<size_t>(row * kColumns + last_column) + 1];
    for (size_t k = begin; k < end; ++k) {
      const int i = cell_members_[k];
      const Keypoint& keypoint = keypoints_[i];
      if (keypoint.level < min_level || keypoint.level > max_level) continue;
      if (std::abs(keypoint.undistorted.x() - cx) > r) continue;
      if (std::abs(keypoint.undistorted.y() - cy) > r) continue;
      visit(i);
    }
  }
}

}  // namespace s3lam
