#include "s3lam/slam/features.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

constexpr int kTableSpacing = 8;  // px between the corners of the undistortion table.
constexpr int kBoundarySamples = 32;
constexpr double kWide = 2.0;       // Sides of the undistorted over those of the original image.
constexpr double kMaxSlope = 5.67;  // Of the rays that the bounds hold: 80 degrees off the axis.

}  // namespace

void FeatureOptions::Visit(OptionVisitor& v) {
  v.Value("num_features", num_features, "keypoints per image", 50, 20000);
  v.Value("num_levels", num_levels, "levels of the image pyramid", 1, 16);
  v.Value("scale_factor", scale_factor, "between neighbouring levels", 1.05, 2.0);
  v.Value("fast_threshold", fast_threshold, "FAST corner threshold [gray levels]", 1, 254);
  v.Value("min_fast_threshold", min_fast_threshold,
          "threshold where the first one finds no corner [gray levels]", 1, 254);
}

Undistorter::Undistorter(const Camera& camera)
    : camera_(camera),
      intrinsics_{camera.FocalX(), camera.FocalY(), camera.PrincipalX(), camera.PrincipalY()} {
  columns_ = camera.width / kTableSpacing + 2;
  rows_ = camera.height / kTableSpacing + 2;
  table_.resize(static_cast<size_t>(columns_) * static_cast<size_t>(rows_));
  const double nan = std::nan("");
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const Eigen::Vector2d pixel(column * kTableSpacing, row * kTableSpacing);
      table_[TableIndex(column, row)] =
          camera.CameraFromImage(pixel).value_or(Eigen::Vector2d(nan, nan));
    }
  }
  FindBounds();
}

void Undistorter::FindBounds() {
  lower_.setConstant(std::numeric_limits<double>::max());
  upper_ = -lower_;
  bool all_found = true;
  const auto include = [&](const Eigen::Vector2d& pixel) {
    const auto undistorted = Undistort(pixel);
    all_found = all_found && undistorted.has_value();
    if (!undistorted) return;
    lower_ = lower_.cwiseMin(*undistorted);
    upper_ = upper_.cwiseMax(*undistorted);
  };
  for (int i = 0; i <= kBoundarySamples; ++i) {
    const double x = static_cast<double>(camera_.width) * i / kBoundarySamples;
    const double y = static_cast<double>(camera_.height) * i / kBoundarySamples;
    for (const Eigen::Vector2d& pixel :
         {Eigen::Vector2d(x, 0.0), Eigen::Vector2d(x, camera_.height), Eigen::Vector2d(0.0, y),
          Eigen::Vector2d(camera_.width, y)}) {
      include(pixel);
    }
  }
  if (!all_found) {  // The circle of a fisheye lies within the image.
    for (int y = 0; y < camera_.height; y += kTableSpacing) {
      for (int x = 0; x < camera_.width; x += kTableSpacing) include(Eigen::Vector2d(x, y));
    }
  }
  if (!(lower_.array() < upper_.array()).all()) {
    throw InputError(
        "the camera's distortion cannot be undone anywhere in the image: is the calibration "
        "right?");
  }
  const Eigen::Vector2d principal(intrinsics_.cx, intrinsics_.cy);
  const Eigen::Vector2d reach = kMaxSlope * Eigen::Vector2d(intrinsics_.fx, intrinsics_.fy);
  lower_ = lower_.cwiseMax(principal - reach);
  upper_ = upper_.cwiseMin(principal + reach);
  const Eigen::Vector2d size(camera_.width, camera_.height);
  is_wide_ = ((upper_ - lower_).array() > kWide * size.array()).any();
}

size_t Undistorter::CellOf(const Keypoint& keypoint, int columns, int rows) const {
  Eigen::Vector2d place = keypoint.undistorted.cast<double>() - lower_;
  Eigen::Vector2d size = upper_ - lower_;
  if (is_wide_) {
    place = keypoint.pixel.cast<double>();
    size = Eigen::Vector2d(camera_.width, camera_.height);
  }
  const auto index = [](double share, int count) {
    return std::clamp(static_cast<int>(share * count), 0, count - 1);
  };
  place = place.cwiseQuotient(size);
  return static_cast<size_t>(index(place.y(), rows) * columns + index(place.x(), columns));
}

std::optional<Eigen::Vector2d> Undistorter::Undistort(const Eigen::Vector2d& pixel) const {
  const int column = std::clamp(static_cast<int>(pixel.x() / kTableSpacing + 0.5), 0, columns_ - 1);
  const int row = std::clamp(static_cast<int>(pixel.y() / kTableSpacing + 0.5), 0, rows_ - 1);
  const Eigen::Vector2d& start = table_[TableIndex(column, row)];
  if (!start.allFinite()) return std::nullopt;
  const Eigen::Vector2d shift((pixel.x() - column * kTableSpacing) / intrinsics_.fx,
                              (pixel.y() - row * kTableSpacing) / intrinsics_.fy);
  const auto uv = camera_.CameraFromImage(pixel, start + shift);
  if (!uv) return std::nullopt;
  return Eigen::Vector2d(intrinsics_.fx * uv->x() + intrinsics_.cx,
                         intrinsics_.fy * uv->y() + intrinsics_.cy);
}

FrameFeatures::FrameFeatures(std::vector<Keypoint> keypoints,
                             std::vector<BinaryDescriptor> descriptors,
                             const Undistorter& undistorter)
    : num_detected_(static_cast<int>(keypoints.size())),
      keypoints_(std::move(keypoints)),
      descriptors_(std::move(descriptors)) {
  BuildGrid(undistorter);
}

int FrameFeatures::Add(const Keypoint& keypoint, const BinaryDescriptor& descriptor) {
  S3LAM_CHECK(!IsFull());
  keypoints_.push_back(keypoint);
  descriptors_.push_back(descriptor);
  return size() - 1;
}

void FrameFeatures::Undistort(const Undistorter& undistorter) {
  for (Keypoint& keypoint : keypoints_) {
    // Where the refined distortion has no inverse, the old place stays: it matches nothing there.
    const auto undistorted = undistorter.Undistort(keypoint.pixel.cast<double>());
    if (undistorted) keypoint.undistorted = undistorted->cast<float>();
  }
  BuildGrid(undistorter);
}

void FrameFeatures::BuildGrid(const Undistorter& undistorter) {
  lower_ = undistorter.lower().cast<float>();
  const Eigen::Vector2f size = (undistorter.upper() - undistorter.lower()).cast<float>();
  cells_per_px_ = Eigen::Vector2f(kColumns, kRows).cwiseQuotient(size);
  std::vector<uint16_t> cell_of(keypoints_.size());
  cell_begin_.assign(static_cast<size_t>(kColumns * kRows) + 1, 0);
  for (size_t i = 0; i < keypoints_.size(); ++i) {
    const Eigen::Vector2f& xy = keypoints_[i].undistorted;
    cell_of[i] = static_cast<uint16_t>(Row(xy.y()) * kColumns + Column(xy.x()));
    ++cell_begin_[static_cast<size_t>(cell_of[i]) + 1];
  }
  std::partial_sum(cell_begin_.begin(), cell_begin_.end(), cell_begin_.begin());
  cell_members_.resize(keypoints_.size());
  std::vector<uint16_t> next(cell_begin_.begin(), cell_begin_.end() - 1);
  for (size_t i = 0; i < keypoints_.size(); ++i) {
    cell_members_[next[cell_of[i]]++] = static_cast<uint16_t>(i);
  }
}

void FrameFeatures::Move(int i, const Eigen::Vector2d& pixel, const Eigen::Vector2d& undistorted,
                         double sigma) {
  keypoints_[i].pixel = pixel.cast<float>();
  keypoints_[i].undistorted = undistorted.cast<float>();
  SetSigma(i, sigma);
}

int FrameFeatures::Column(double x) const {
  const double cell = (x - lower_.x()) * cells_per_px_.x();
  return static_cast<int>(std::clamp(cell, 0.0, kColumns - 1.0));
}

int FrameFeatures::Row(double y) const {
  const double cell = (y - lower_.y()) * cells_per_px_.y();
  return static_cast<int>(std::clamp(cell, 0.0, kRows - 1.0));
}

std::vector<double> LevelSigmas(const FeatureOptions& options) {
  std::vector<double> sigmas(static_cast<size_t>(options.num_levels));
  for (size_t level = 0; level < sigmas.size(); ++level) {
    sigmas[level] = std::pow(options.scale_factor, static_cast<double>(level));
  }
  return sigmas;
}

}  // namespace s3lam
