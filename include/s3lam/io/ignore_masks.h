#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string>

#include "s3lam/scene/panoptic_frame.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// Where features may be used: 255, and 0 on things of dynamic classes and `margin_px` around them.
/// Of the size of the panoptic mask.
cv::Mat MakeIgnoreMask(const PanopticFrame& frame, const ClassTable& class_table, int margin_px);

/// Masks as COLMAP's feature extractor takes them (--ImageReader.mask_path): of image a/b.jpg in
/// <masks>/a/b.jpg.png. If `masks` is a file, it is the mask of every image.
std::filesystem::path IgnoreMaskPath(const std::filesystem::path& masks,
                                     const std::string& image_name);
void WriteIgnoreMask(const cv::Mat& mask, const std::filesystem::path& directory,
                     const std::string& image_name);
/// Empty if the image has no mask there. Throws InputError naming the file if it is not a gray PNG
/// of the size given.
cv::Mat ReadIgnoreMask(const std::filesystem::path& masks, const std::string& image_name,
                       const cv::Size& size);
/// Whether the image has a mask there.
bool HasIgnoreMask(const std::filesystem::path& masks, const std::string& image_name);

}  // namespace s3lam
