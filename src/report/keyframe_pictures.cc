#include "s3lam/report/keyframe_pictures.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <sstream>
#include <stdexcept>

#include "s3lam/base/error.h"
#include "s3lam/base/parallel.h"
#include "s3lam/io/image_file.h"

namespace s3lam {
namespace fs = std::filesystem;
namespace {

/// Empty unless the whole text is a number that is not negative.
std::optional<int> ParseCount(const std::string& text) {
  int count = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), count);
  const bool is_count = error == std::errc() && end == text.data() + text.size() && count >= 0;
  return is_count ? std::optional(count) : std::nullopt;
}

const Image* FindImage(const Reconstruction& model, const std::string& name) {
  const auto it = std::find_if(model.images.begin(), model.images.end(),
                               [&](const auto& entry) { return entry.second.name == name; });
  if (it == model.images.end()) ThrowInputError("{}: no image of the model has this name", name);
  return &it->second;
}

}  // namespace

std::vector<const Image*> SpreadImages(const Reconstruction& model, int count) {
  std::vector<const Image*> all;
  for (const auto& [id, image] : model.images) all.push_back(&image);
  const size_t wanted = std::min(all.size(), static_cast<size_t>(count));
  std::vector<const Image*> spread;
  for (size_t i = 0; i < wanted; ++i) {
    spread.push_back(all[wanted == 1 ? 0 : i * (all.size() - 1) / (wanted - 1)]);
  }
  return spread;
}

std::vector<const Image*> SelectImages(const Reconstruction& model, const std::string& selection) {
  if (selection == "all") return SpreadImages(model, std::numeric_limits<int>::max());
  if (const auto count = ParseCount(selection)) return SpreadImages(model, *count);
  std::vector<const Image*> images;
  std::istringstream names(selection);
  for (std::string name; std::getline(names, name, ',');) images.push_back(FindImage(model, name));
  return images;
}

cv::Mat DrawKeyframe(const Reconstruction& model, const Image& image, const fs::path& path,
                     const SemanticMap& map, const RowOfPoint& rows,
                     std::span<const PlanarSurface> planes, int max_width) {
  const Camera& camera = model.CameraOf(image);
  const cv::Mat original = ReadImageFile(path, cv::IMREAD_COLOR);
  if (original.cols != static_cast<int>(camera.width) ||
      original.rows != static_cast<int>(camera.height)) {
    ThrowInputError("{}: {} x {} px, but its camera has {} x {}", path.string(), original.cols,
                    original.rows, camera.width, camera.height);
  }
  OverlayOptions overlay;
  overlay.scale = std::min(1.0, double(max_width) / original.cols);
  cv::Mat picture;
  cv::resize(original, picture, {}, overlay.scale, overlay.scale, cv::INTER_AREA);
  DrawOverlay(camera, image, map, rows, planes, model, overlay, picture);
  return picture;
}

void WriteKeyframePictures(const Reconstruction& model, const SemanticMap& map,
                           const std::vector<const Image*>& images, const fs::path& image_directory,
                           int num_threads, const fs::path& directory) {
  const RowOfPoint rows = RowsOfPoints(map);
  std::vector<PlanarSurface> planes;
  for (const auto& [id, plane] : map.planes) planes.push_back(plane);
  ParallelFor(images.size(), num_threads, [&](size_t i) {
    const std::string& name = images[i]->name;
    const cv::Mat picture = DrawKeyframe(model, *images[i], image_directory / name, map, rows,
                                         planes, std::numeric_limits<int>::max());
    const fs::path path = directory / (name + ".png");
    fs::create_directories(path.parent_path());
    if (!cv::imwrite(path.string(), picture)) {
      throw std::runtime_error(path.string() + ": cannot write");
    }
  });
}

}  // namespace s3lam
