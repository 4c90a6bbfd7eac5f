// What things in the street look like.

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "painter.h"

namespace s3lam::synthetic {
namespace {

void PaintWindow(Painter& p, double x, double y, double w, double h) {
  Rng& rng = p.rng();
  const double frame = std::max(1.5, p.m(rng.Uniform(0.05, 0.12)));
  p.FillRect(x - frame, y - frame, w + 2.0 * frame, h + 2.0 * frame,
             p.Vary(cv::Scalar::all(rng.Below(3) == 0 ? 90.0 : 215.0), 25.0));
  const cv::Scalar glass = p.Vary(cv::Scalar(75, 62, 50), 25.0);
  p.FillRect(x, y, w, h, glass);
  // Curtains, blinds, reflections, flower boxes: no two windows alike.
  if (rng.Below(2) == 0) {
    p.FillRect(x, y, w * rng.Uniform(0.15, 0.4), h, p.Vary(cv::Scalar::all(165.0), 50.0));
  }
  if (rng.Below(2) == 0) {
    const double s = rng.Uniform(0.15, 0.4);
    p.FillRect(x + w * (1.0 - s), y, w * s, h, p.Vary(cv::Scalar::all(165.0), 50.0));
  }
  if (rng.Below(3) == 0) {
    p.FillRect(x, y, w, h * rng.Uniform(0.15, 0.6), p.Vary(cv::Scalar::all(190.0), 40.0));
  }
  for (int i = 0; i < 3; ++i) {
    p.FillRect(x + rng.Uniform(0.0, 0.8) * w, y + rng.Uniform(0.0, 0.8) * h, 0.18 * w, 0.12 * h,
               p.Vary(glass, 70.0));
  }
  const double bar = std::max(1.0, p.m(0.04));
  if (rng.Below(3) != 0) p.FillRect(x + 0.5 * w, y, bar, h, cv::Scalar::all(205.0));
  if (rng.Below(2) == 0) p.FillRect(x, y + 0.35 * h, w, bar, cv::Scalar::all(205.0));
  p.FillRect(x - 2.0 * frame, y + h + frame, w + 4.0 * frame, frame,
             p.Vary(cv::Scalar::all(130.0), 50.0));
  if (rng.Below(4) == 0) {
    for (int i = 0; i < 9; ++i) {
      p.FillRect(x + rng.Uniform(0.0, 0.9) * w, y + h - rng.Uniform(0.0, 0.15) * h, 0.08 * w,
                 0.1 * h, p.AnyColor());
    }
  }
}

void PaintShopOrDoor(Painter& p, double x, double width, double floor_height) {
  Rng& rng = p.rng();
  const double base = p.height();
  const double h = std::min(0.85 * floor_height, p.m(rng.Uniform(2.0, 2.4)));
  const double w = std::min(0.5 * width, p.m(rng.Uniform(0.9, 1.8)));
  p.FillRect(x, base - h, w, h, p.AnyColor());
  for (const double row : {0.0, 1.0}) {
    for (const double column : {0.0, 1.0}) {
      p.FillRect(x + w * (0.1 + 0.42 * column), base - h * (0.92 - 0.45 * row), 0.36 * w, 0.36 * h,
                 p.AnyColor());
    }
  }
  const cv::Rect sign(static_cast<int>(x - 0.3 * w), static_cast<int>(base - h - p.m(0.5)),
                      static_cast<int>(1.8 * w), static_cast<int>(p.m(0.42)));
  cv::rectangle(p.image(), sign, p.AnyColor(), cv::FILLED);
  p.AddText(sign, 0.6 * sign.height, p.AnyColor());
}

}  // namespace

void PaintFacade(Painter& p) {
  Rng& rng = p.rng();
  if (rng.Below(2) == 0) {
    PaintBrick(p);
  } else {
    PaintPlaster(p);
    p.AddSoftBlobs(1.0, 0.1, 0.5, 20.0);
  }
  const double floor_height = p.m(rng.Uniform(2.7, 3.1));
  int storey = 0;
  for (double top = p.height() - floor_height; top > -0.6 * floor_height; top -= floor_height) {
    double x = p.m(rng.Uniform(0.4, 1.0));
    while (x < p.width() - p.m(0.8)) {
      const double w = p.m(rng.Uniform(0.8, 1.7));
      if (x + w > p.width() - p.m(0.2)) break;
      if (storey == 0 && rng.Below(3) == 0) {
        PaintShopOrDoor(p, x, p.width(), floor_height);
      } else {
        const double h = p.m(rng.Uniform(1.1, 1.6));
        PaintWindow(p, x, top + p.m(rng.Uniform(0.55, 0.8)), w, h);
      }
      x += w + p.m(rng.Uniform(0.5, 1.4));
    }
    if (rng.Below(2) == 0) {
      p.FillRect(0.0, top, p.width(), std::max(1.0, p.m(0.1)), p.Vary(p.Mix(0.5), 40.0));
    }
    ++storey;
  }
  p.AddFlecks(6.0, 0.02, 0.12, 60.0);
  p.AddNoiseOctaves(24.0, 4.0);
}

void PaintAsphalt(Painter& p) {
  p.AddNoiseOctaves(p.m(1.2), 4.0, 1.25);  // Down to the aggregate.
  p.AddSoftBlobs(0.5, 0.1, 0.5, 18.0);     // Mended spots.
  p.AddSoftBlobs(2.0, 0.02, 0.1, 35.0);    // Oil, chewing gum.
  p.AddFlecks(14.0, 0.02, 0.15, 45.0);     // Leaves, litter, stones.
  p.AddCracks(0.8, 1.6, 45.0);
}

void PaintPavement(Painter& p) {
  Rng& rng = p.rng();
  p.Fill(p.Mix(1.0));
  const double size = p.m(rng.Uniform(0.3, 0.5));
  const double gap = std::max(1.0, p.m(0.015));
  for (double y = 0.0; y < p.height(); y += size) {
    for (double x = -rng.Uniform(0.0, size); x < p.width(); x += size) {
      p.FillRect(x, y, size - gap, size - gap, p.Vary(p.Mix(rng.Uniform(0.0, 0.5)), 18.0));
    }
  }
  p.AddFlecks(35.0, 0.02, 0.12, 60.0);
  p.AddCracks(1.0, 0.6, 45.0);
  p.AddNoiseOctaves(p.m(0.3), 7.0);
}

void PaintCarBody(Painter& p) {
  Rng& rng = p.rng();
  const double w = p.width();
  const double h = p.height();
  p.AddNoise(0.4 * w, 0.25 * h, 25.0);  // What the paint reflects.
  p.AddNoise(0.1 * w, 0.1 * h, 12.0);
  p.FillRect(0.0, 0.86 * h, w, 0.14 * h, cv::Scalar::all(35.0));
  p.FillRect(0.0, rng.Uniform(0.4, 0.55) * h, w, std::max(1.0, 0.03 * h), p.Mix(0.7));
  for (int i = 1; i < 4; ++i) {  // Door gaps and handles.
    const double x = w * (0.22 * i + rng.Uniform(-0.03, 0.03));
    p.FillRect(x, 0.05 * h, std::max(1.0, 0.006 * w), 0.8 * h, p.Mix(1.0));
    p.FillRect(x + 0.02 * w, 0.25 * h, 0.05 * w, 0.06 * h, p.Vary(p.Mix(0.8), 40.0));
  }
  for (const double x : {0.01, 0.94}) {  // Lamps.
    p.FillRect(x * w, 0.2 * h, 0.05 * w, 0.2 * h, p.Vary(cv::Scalar(60, 90, 200), 40.0));
  }
  p.AddText(cv::Rect(static_cast<int>(0.4 * w), static_cast<int>(0.6 * h),
                     static_cast<int>(0.25 * w), static_cast<int>(0.15 * h)),
            0.1 * h, p.Mix(1.0));
  p.AddFlecks(120.0, 0.01, 0.08, 80.0);  // Reflections, dirt.
  p.AddNoiseOctaves(p.m(0.2), 8.0);
}

}  // namespace s3lam::synthetic
