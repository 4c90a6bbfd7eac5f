#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "s3lam/slam/features.h"

namespace s3lam {
namespace {

constexpr int kPatchRadius = 15;
constexpr int kBorder = 19;              // px of a level; keeps patch and descriptor inside.
constexpr int kCellSize = 32;            // px, for the second threshold
constexpr size_t kMaxKeypoints = 60000;  // Indices are 16 bits wide.

/// A corner in the pixels of its level.
struct Corner {
  int x;
  int y;
  float response;
};

/// FAST corners of one level; cells that the first threshold leaves empty are searched again.
std::vector<Corner> DetectCorners(const FeatureOptions& options, const cv::Mat& image) {
  const cv::Rect inner(kBorder - 3, kBorder - 3, image.cols - 2 * kBorder + 6,
                       image.rows - 2 * kBorder + 6);  // FAST itself skips three pixels.
  std::vector<Corner> corners;
  if (inner.width < 7 || inner.height < 7) return corners;
  const int columns = (inner.width + kCellSize - 1) / kCellSize;
  const int rows = (inner.height + kCellSize - 1) / kCellSize;
  std::vector<uint8_t> has_corner(static_cast<size_t>(columns) * static_cast<size_t>(rows), 0);
  std::vector<cv::KeyPoint> found;
  cv::FAST(image(inner), found, options.fast_threshold, true);
  for (const cv::KeyPoint& keypoint : found) {
    const int x = static_cast<int>(keypoint.pt.x);
    const int y = static_cast<int>(keypoint.pt.y);
    has_corner[static_cast<size_t>(y / kCellSize * columns + x / kCellSize)] = 1;
    corners.push_back({x + inner.x, y + inner.y, keypoint.response});
  }
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      if (has_corner[static_cast<size_t>(row * columns + column)] != 0) continue;
      const cv::Rect cell = cv::Rect(inner.x + column * kCellSize - 3,
                                     inner.y + row * kCellSize - 3, kCellSize + 6, kCellSize + 6) &
                            inner;
      if (cell.width < 7 || cell.height < 7) continue;
      cv::FAST(image(cell), found, options.min_fast_threshold, true);
      for (const cv::KeyPoint& keypoint : found) {
        corners.push_back({static_cast<int>(keypoint.pt.x) + cell.x,
                           static_cast<int>(keypoint.pt.y) + cell.y, keypoint.response});
      }
    }
  }
  return corners;
}

/// A node of the quadtree: corners [begin, end) of the shared array.
struct Node {
  int x0, y0, x1, y1;
  size_t begin, end;
  [[nodiscard]] size_t size() const { return end - begin; }
};

void SplitNode(const Node& node, std::vector<Corner>& corners, std::vector<Node>& out) {
  // A node far from square is cut across its longer side only.
  const int width = node.x1 - node.x0;
  const int height = node.y1 - node.y0;
  const int mx = 2 * height > 3 * width ? node.x1 : (node.x0 + node.x1) / 2;
  const int my = 2 * width > 3 * height ? node.y1 : (node.y0 + node.y1) / 2;
  const auto at = [&](size_t i) { return corners.begin() + static_cast<std::ptrdiff_t>(i); };
  const auto below = [&](const Corner& c) { return c.y < my; };
  const auto left = [&](const Corner& c) { return c.x < mx; };
  const auto middle = std::partition(at(node.begin), at(node.end), below);
  const auto upper_middle = std::partition(at(node.begin), middle, left);
  const auto lower_middle = std::partition(middle, at(node.end), left);
  const auto add = [&](int x0, int y0, int x1, int y1, auto begin, auto end) {
    if (begin == end) return;
    out.push_back({x0, y0, x1, y1, static_cast<size_t>(begin - corners.begin()),
                   static_cast<size_t>(end - corners.begin())});
  };
  add(node.x0, node.y0, mx, my, at(node.begin), upper_middle);
  add(mx, node.y0, node.x1, my, upper_middle, middle);
  add(node.x0, my, mx, node.y1, middle, lower_middle);
  add(mx, my, node.x1, node.y1, lower_middle, at(node.end));
}

/// Keeps about `count` corners spread over the image: quadtree nodes are split, the fullest first,
/// until there are enough; each keeps its strongest corner.
std::vector<Corner> SpreadCorners(std::vector<Corner> corners, const cv::Size& size, size_t count) {
  if (corners.size() <= count) return corners;
  std::vector<Node> nodes{{0, 0, size.width, size.height, 0, corners.size()}};
  std::vector<Node> next;
  while (nodes.size() < count) {
    // Fullest first; ties by place, so that the order is the same everywhere.
    std::sort(nodes.begin(), nodes.end(), [](const Node& a, const Node& b) {
      if (a.size() != b.size()) return a.size() > b.size();
      return std::pair(a.y0, a.x0) < std::pair(b.y0, b.x0);
    });
    next.clear();
    size_t total = nodes.size();
    bool split_any = false;
    for (const Node& node : nodes) {
      const bool can_split = node.size() > 1 && (node.x1 - node.x0 > 1 || node.y1 - node.y0 > 1);
      if (!can_split || total >= count) {
        next.push_back(node);
        continue;
      }
      const size_t before = next.size();
      SplitNode(node, corners, next);
      total += next.size() - before - 1;
      split_any = true;
    }
    nodes.swap(next);
    if (!split_any) break;
  }
  std::vector<Corner> kept;
  kept.reserve(nodes.size());
  for (const Node& node : nodes) {
    kept.push_back(*std::max_element(corners.begin() + static_cast<std::ptrdiff_t>(node.begin),
                                     corners.begin() + static_cast<std::ptrdiff_t>(node.end),
                                     [](const Corner& a, const Corner& b) {
                                       return std::tuple(a.response, -a.y, -a.x) <
                                              std::tuple(b.response, -b.y, -b.x);
                                     }));
  }
  std::sort(kept.begin(), kept.end(), [](const Corner& a, const Corner& b) {
    return std::pair(a.y, a.x) < std::pair(b.y, b.x);
  });
  return kept;
}

/// Half widths of the rows of a disc of kPatchRadius.
std::array<int, kPatchRadius + 1> DiscRows() {
  std::array<int, kPatchRadius + 1> half{};
  for (int v = 0; v <= kPatchRadius; ++v) {
    half[static_cast<size_t>(v)] =
        static_cast<int>(std::lround(std::sqrt(kPatchRadius * kPatchRadius - v * v)));
  }
  return half;
}

/// Direction from a corner to its patch's centroid of intensity (Rosin 1999) [rad].
float PatchAngle(const cv::Mat& image, int x, int y) {
  static const std::array<int, kPatchRadius + 1> kHalf = DiscRows();
  int m10 = 0;
  int m01 = 0;
  for (int v = -kPatchRadius; v <= kPatchRadius; ++v) {
    const uchar* row = image.ptr<uchar>(y + v) + x;
    const int half = kHalf[static_cast<size_t>(std::abs(v))];
    int sum = 0;
    for (int u = -half; u <= half; ++u) {
      m10 += u * row[u];
      sum += row[u];
    }
    m01 += v * sum;
  }
  return std::atan2(static_cast<float>(m01), static_cast<float>(m10));
}

/// Number of keypoints wanted on each level: proportional to the level's side length.
std::vector<size_t> LevelCounts(const FeatureOptions& options) {
  double sum = 0.0;
  for (int level = 0; level < options.num_levels; ++level) {
    sum += std::pow(options.scale_factor, -level);
  }
  std::vector<size_t> counts;
  for (int level = 0; level < options.num_levels; ++level) {
    counts.push_back(static_cast<size_t>(
        std::lround(options.num_features * std::pow(options.scale_factor, -level) / sum)));
  }
  return counts;
}

struct LevelOutput {
  std::vector<Keypoint>& keypoints;
  std::vector<BinaryDescriptor>& descriptors;
};

void DescribeLevel(const ImagePyramid& pyramid, int level, const std::vector<Corner>& corners,
                   const Undistorter& undistorter, LevelOutput out) {
  const cv::Mat& image = pyramid.levels[level];
  constexpr float kDegreesPerRadian = 57.29577951F;
  std::vector<cv::KeyPoint> keypoints;
  keypoints.reserve(corners.size());
  for (const Corner& corner : corners) {
    const float angle = PatchAngle(image, corner.x, corner.y);
    const float degrees = (angle < 0.0F ? angle + 6.283185307F : angle) * kDegreesPerRadian;
    keypoints.emplace_back(static_cast<float>(corner.x), static_cast<float>(corner.y),
                           2.0F * kPatchRadius + 1.0F, degrees, corner.response, 0, 0);
  }
  if (keypoints.empty()) return;
  // One level at a time: OpenCV blurs this level and samples the ORB pattern at our keypoints.
  const cv::Ptr<cv::ORB> orb =
      cv::ORB::create(static_cast<int>(keypoints.size()), 1.2F, 1, kBorder - 1, 0, 2,
                      cv::ORB::FAST_SCORE, 2 * kPatchRadius + 1);
  cv::Mat rows;
  orb->compute(image, keypoints, rows);
  for (size_t i = 0; i < keypoints.size(); ++i) {
    const Eigen::Vector2d pixel = pyramid.FromLevel({keypoints[i].pt.x, keypoints[i].pt.y}, level);
    const auto undistorted = undistorter.Undistort(pixel);
    if (!undistorted) continue;
    Keypoint keypoint;
    keypoint.pixel = pixel.cast<float>();
    keypoint.undistorted = undistorted->cast<float>();
    keypoint.angle = keypoints[i].angle / kDegreesPerRadian;
    keypoint.sigma = static_cast<float>(pyramid.scales[level].mean());
    keypoint.level = static_cast<uint8_t>(level);
    out.keypoints.push_back(keypoint);
    BinaryDescriptor descriptor;
    std::copy_n(rows.ptr<uint8_t>(static_cast<int>(i)), descriptor.size(), descriptor.begin());
    out.descriptors.push_back(descriptor);
  }
}

void RemoveMasked(const cv::Mat& mask, const Eigen::Vector2d& scale, std::vector<Corner>& corners) {
  if (mask.empty()) return;
  std::erase_if(corners, [&](const Corner& corner) {
    return IsMasked(mask, {(corner.x + 0.5) * scale.x(), (corner.y + 0.5) * scale.y()});
  });
}

}  // namespace

bool IsMasked(const cv::Mat& mask, const Eigen::Vector2d& pixel) {
  if (mask.empty()) return false;
  const int x = std::clamp(static_cast<int>(pixel.x()), 0, mask.cols - 1);
  const int y = std::clamp(static_cast<int>(pixel.y()), 0, mask.rows - 1);
  return mask.at<uint8_t>(y, x) == 0;
}

ImagePyramid BuildPyramid(const FeatureOptions& options, const cv::Mat& gray) {
  ImagePyramid pyramid;
  for (int level = 0; level < options.num_levels; ++level) {
    const double factor = std::pow(options.scale_factor, level);
    const cv::Size size(static_cast<int>(std::lround(gray.cols / factor)),
                        static_cast<int>(std::lround(gray.rows / factor)));
    if (size.width <= 2 * kBorder || size.height <= 2 * kBorder) break;
    cv::Mat image = gray;
    if (level > 0) {
      image = cv::Mat();
      cv::resize(pyramid.levels.back(), image, size, 0.0, 0.0, cv::INTER_LINEAR);
    }
    pyramid.levels.push_back(image);
    pyramid.scales.emplace_back(static_cast<double>(gray.cols) / size.width,
                                static_cast<double>(gray.rows) / size.height);
  }
  return pyramid;
}

FrameFeatures ExtractFeatures(const FeatureOptions& options, const Undistorter& undistorter,
                              const cv::Mat& gray, const cv::Mat& mask) {
  std::vector<Keypoint> keypoints;
  std::vector<BinaryDescriptor> descriptors;
  const std::vector<size_t> counts = LevelCounts(options);
  const ImagePyramid pyramid = BuildPyramid(options, gray);
  for (size_t level = 0; level < pyramid.levels.size(); ++level) {
    const cv::Mat& image = pyramid.levels[level];
    std::vector<Corner> corners = DetectCorners(options, image);
    RemoveMasked(mask, pyramid.scales[level], corners);
    corners = SpreadCorners(std::move(corners), image.size(), counts[level]);
    if (keypoints.size() + corners.size() > kMaxKeypoints) break;
    DescribeLevel(pyramid, static_cast<int>(level), corners, undistorter, {keypoints, descriptors});
  }
  return {std::move(keypoints), std::move(descriptors), undistorter};
}

}  // namespace s3lam
