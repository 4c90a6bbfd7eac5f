#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <span>
#include <string>
#include <vector>

#include "s3lam/report/overlay.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// Up to `count` of the images, evenly spread, in order.
std::vector<const Image*> SpreadImages(const Reconstruction& model, int count);

/// The images that a selection means: "all", a number of them (evenly spread), or names with commas
/// between them. Throws InputError for a name that no image has.
std::vector<const Image*> SelectImages(const Reconstruction& model, const std::string& selection);

/// DrawOverlay on the image file `path`, in BGR, at most `max_width` [px] wide. Throws InputError
/// if the file cannot be read or is not of its camera's size.
cv::Mat DrawKeyframe(const Reconstruction& model, const Image& image,
                     const std::filesystem::path& path, const SemanticMap& map,
                     const RowOfPoint& rows, std::span<const PlanarSurface> planes, int max_width);

/// Writes DrawKeyframe of each image to <directory>/<its name>.png, all planes of the map on it.
/// The images are <image_directory>/<name>. Throws InputError as above.
void WriteKeyframePictures(const Reconstruction& model, const SemanticMap& map,
                           const std::vector<const Image*>& images,
                           const std::filesystem::path& image_directory, int num_threads,
                           const std::filesystem::path& directory);

}  // namespace s3lam
