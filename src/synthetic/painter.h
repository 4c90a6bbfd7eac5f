#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>

#include "s3lam/base/rng.h"
#include "s3lam/synthetic/texture.h"

namespace s3lam::synthetic {

/// A picture being painted, with the brushes that several textures share. Lengths are in texels
/// unless said; `m` converts from metres.
class Painter {
 public:
  Painter(const TextureSpec& spec, cv::Size size, double texels_per_m);

  [[nodiscard]] int width() const { return image_.cols; }
  [[nodiscard]] int height() const { return image_.rows; }
  [[nodiscard]] double m(double metres) const { return metres * texels_per_m_; }
  Rng& rng() { return rng_; }
  cv::Mat& image() { return image_; }

  [[nodiscard]] const cv::Scalar& primary() const { return primary_; }
  [[nodiscard]] const cv::Scalar& secondary() const { return secondary_; }
  /// Between primary (0) and secondary (1).
  [[nodiscard]] cv::Scalar Mix(double share) const;
  /// A colour anywhere.
  cv::Scalar AnyColor();
  /// `color` made lighter or darker by up to `amount` gray levels.
  cv::Scalar Vary(const cv::Scalar& color, double amount);

  void Fill(const cv::Scalar& color);
  /// Adds smooth noise: random values on a grid of `cell_x` by `cell_y` texels, interpolated.
  void AddNoise(double cell_x, double cell_y, double amplitude);
  /// Adds noise of several cell sizes, from `largest` down to about one texel, halving; the
  /// amplitude is multiplied by `growth` from each to the next finer one.
  void AddNoiseOctaves(double largest, double amplitude, double growth = 1.0);
  /// Small irregular polygons of random tones: what corner detectors like. `count` per square metre
  /// of texture, their size log-uniform in metres.
  void AddFlecks(double count_per_m2, double min_m, double max_m, double contrast);
  /// Wandering dark or light lines.
  void AddCracks(double count_per_m2, double length_m, double contrast);
  void AddSoftBlobs(double count_per_m2, double min_m, double max_m, double contrast);
  /// Lines of random letters filling a box, letters `letter_height` high.
  void AddText(const cv::Rect& box, double letter_height, const cv::Scalar& color);
  void FillRect(double x, double y, double w, double h, const cv::Scalar& color);
  /// Blobs of multi-scale noise above a threshold take the secondary colour.
  void AddMottling(double largest);
  [[nodiscard]] double AreaM2() const;

 private:
  cv::Mat RandomGrid(cv::Size size, double amplitude);
  cv::Mat OctaveNoise(double largest, double smallest, double growth);
  void Add(const cv::Mat& noise, double gain);
  std::string RandomWord();

  cv::Mat image_;  // BGR, 8 bit.
  double texels_per_m_;
  Rng rng_;
  cv::Scalar primary_, secondary_;
};

void PaintCover(Painter& p);
void PaintPage(Painter& p);
void PaintKeyboard(Painter& p);
void PaintScreen(Painter& p);
void PaintWood(Painter& p);
void PaintFabric(Painter& p);
void PaintPlaster(Painter& p);
void PaintBrick(Painter& p);
void PaintTiles(Painter& p);
void PaintFacade(Painter& p);
void PaintAsphalt(Painter& p);
void PaintPavement(Painter& p);
void PaintCarBody(Painter& p);

}  // namespace s3lam::synthetic
