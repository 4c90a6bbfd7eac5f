#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>

#include "s3lam/geometry/rigid3.h"
#include "s3lam/synthetic/scene.h"

namespace s3lam {

struct RenderedFrame {
  cv::Mat image;   // 8 bit, BGR or gray as Scene::imaging says; empty if not asked for.
  cv::Mat labels;  // 32-bit signed: SceneObject::id at the pixel's centre, 0 for the background.
  cv::Mat depth;   // 32-bit float: z in the camera [m] at the pixel's centre, 0 for the background.
  Rigid3 world_from_camera;
};

/// Labels and depth need no textures, which take most of the set-up's time and memory.
enum class RenderContent { kImages, kLabelsOnly };

/// Draws a scene: exact visibility per pixel through the distorted camera (each pixel's ray is
/// computed once), band-limited textures (mip maps), four sub-exposures that are shifted within the
/// pixel and spread over the exposure time (antialiasing and motion blur in one), then vignetting,
/// exposure and noise. A frame is a pure function of the scene and its number.
class Renderer {
 public:
  /// Paints all textures, on up to `num_threads` threads, unless only labels are wanted. Keeps a
  /// reference to the scene.
  explicit Renderer(const Scene& scene, int num_threads = 1,
                    RenderContent content = RenderContent::kImages);
  ~Renderer();
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  /// Thread-safe. `frame` may be any number >= 0. Throws std::logic_error with kLabelsOnly.
  [[nodiscard]] RenderedFrame Render(int frame) const;
  /// As Render without the image, which takes most of the time.
  [[nodiscard]] RenderedFrame RenderLabels(int frame) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace s3lam
