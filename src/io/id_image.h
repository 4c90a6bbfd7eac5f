#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <opencv2/core/mat.hpp>

#include "s3lam/scene/panoptic_frame.h"

namespace s3lam {

using IdMatrix = Eigen::Matrix<int32_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A label or an id for every pixel.
struct IdImage {
  IdMatrix ids;
  int32_t minus_one = -1;  // What -1 becomes in the file's type: 255, 65535, -1.
};

/// Reads an image of ids as it is stored: a gray PNG of 8 or 16 bits, a PNG with a palette (the
/// indices, not the colours), an RGB PNG (R + 256 G + 65536 B), or a two-dimensional .npy of
/// integers. Throws InputError naming the path and the reason.
IdImage ReadIdImage(const std::filesystem::path& path);

/// R + 256 G + 65536 B of every pixel of an image of 8 bits as OpenCV has it: BGR or BGRA.
SegmentImage IdsFromColours(const cv::Mat& bgr);

/// Whether a PNG has more than one channel and no palette. Throws as above.
bool HasColourPixels(const std::filesystem::path& path);

}  // namespace s3lam
