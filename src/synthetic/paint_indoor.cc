// What things indoors look like.

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "painter.h"

namespace s3lam::synthetic {
namespace {

cv::Rect RandomRect(Painter& p, double min_share, double max_share) {
  const double w = p.width() * p.rng().Uniform(min_share, max_share);
  const double h = p.height() * p.rng().Uniform(min_share, max_share);
  return {static_cast<int>(p.rng().Uniform(-0.2 * w, p.width() - 0.8 * w)),
          static_cast<int>(p.rng().Uniform(-0.2 * h, p.height() - 0.8 * h)), static_cast<int>(w),
          static_cast<int>(h)};
}

void AddShape(Painter& p) {
  const cv::Rect r = RandomRect(p, 0.08, 0.4);
  const cv::Scalar color = p.AnyColor();
  switch (p.rng().Below(4)) {
    case 0:
      cv::rectangle(p.image(), r, color, cv::FILLED);
      return;
    case 1:
      cv::ellipse(p.image(), cv::Point(r.x + r.width / 2, r.y + r.height / 2),
                  cv::Size(std::max(1, r.width / 2), std::max(1, r.height / 2)),
                  p.rng().Uniform(0.0, 180.0), 0.0, 360.0, color, cv::FILLED, cv::LINE_AA);
      return;
    default: {
      std::vector<cv::Point> outline;
      for (int k = 0; k < 5; ++k) {
        outline.emplace_back(r.x + static_cast<int>(p.rng().Uniform(0.0, r.width)),
                             r.y + static_cast<int>(p.rng().Uniform(0.0, r.height)));
      }
      cv::fillPoly(p.image(), std::vector<std::vector<cv::Point>>{outline}, color, cv::LINE_AA);
    }
  }
}

}  // namespace

void PaintCover(Painter& p) {
  Rng& rng = p.rng();
  for (int i = 0; i < 8; ++i) AddShape(p);
  const int small = std::min(p.width(), p.height());
  // Lettering from headline to small print, each block somewhere else.
  for (const double share : {0.16, 0.09, 0.05, 0.05, 0.03}) {
    const cv::Rect box = RandomRect(p, 0.3, 0.7);
    const int lines = 1 + static_cast<int>(rng.Below(4));
    p.AddText(cv::Rect(box.x, box.y, box.width,
                       std::min(box.height, static_cast<int>(lines * 1.6 * share * small) + 2)),
              share * small, rng.Below(2) == 0 ? p.secondary() : p.AnyColor());
  }
  p.AddFlecks(60.0 / p.AreaM2(), 0.02 * small / p.m(1.0), 0.1 * small / p.m(1.0), 90.0);
  p.AddNoiseOctaves(48.0, 3.0);
}

void PaintPage(Painter& p) {
  Rng& rng = p.rng();
  const double margin = 0.06 * p.width();
  const double letter = std::max(3.5, p.m(0.0032));
  p.AddText(cv::Rect(static_cast<int>(margin), static_cast<int>(margin),
                     static_cast<int>(p.width() - 2.0 * margin), static_cast<int>(5.0 * letter)),
            2.6 * letter, p.secondary());
  const int columns = 2;
  const double column_width = (p.width() - (columns + 1) * margin) / columns;
  for (int c = 0; c < columns; ++c) {
    double y = margin + 6.0 * letter;
    const double x = margin + c * (column_width + margin);
    while (y < p.height() - margin) {
      const double block = rng.Uniform(0.12, 0.3) * p.height();
      const double left = std::min(block, p.height() - margin - y);
      const cv::Rect box(static_cast<int>(x), static_cast<int>(y), static_cast<int>(column_width),
                         static_cast<int>(left));
      if (rng.Below(3) == 0) {
        cv::rectangle(p.image(), box, p.AnyColor(), cv::FILLED);
        for (int i = 0; i < 6; ++i) {
          p.FillRect(x + rng.Uniform(0.0, 0.8) * column_width, y + rng.Uniform(0.0, 0.8) * left,
                     rng.Uniform(0.05, 0.2) * column_width, rng.Uniform(0.05, 0.2) * left,
                     p.AnyColor());
        }
      } else {
        p.AddText(box, letter * rng.Uniform(0.9, 1.3), p.secondary());
      }
      y += block + 2.0 * letter;
    }
  }
  p.AddNoiseOctaves(32.0, 2.0);
}

void PaintKeyboard(Painter& p) {
  Rng& rng = p.rng();
  const int rows = 5;
  const double pitch = static_cast<double>(p.height()) / (rows + 0.6);
  for (int row = 0; row < rows; ++row) {
    double x = 0.3 * pitch;
    while (x < p.width() - 0.6 * pitch) {
      double key = pitch * (rng.Below(5) == 0 ? rng.Uniform(1.3, 2.4) : 1.0);
      key = std::min(key, p.width() - 0.2 * pitch - x);
      const double y = (row + 0.3) * pitch;
      p.FillRect(x, y, key - 0.14 * pitch, 0.86 * pitch, p.Vary(p.Mix(0.12), 14.0));
      p.AddText(cv::Rect(static_cast<int>(x + 0.15 * pitch), static_cast<int>(y + 0.1 * pitch),
                         static_cast<int>(0.5 * key), static_cast<int>(0.5 * pitch)),
                0.34 * pitch, p.Vary(p.secondary(), 25.0));
      x += key;
    }
  }
  p.AddNoiseOctaves(16.0, 3.0);
}

void PaintScreen(Painter& p) {
  Rng& rng = p.rng();
  p.AddNoiseOctaves(96.0, 10.0);
  const double unit = p.height() / 40.0;
  for (int i = 0; i < 6; ++i) {  // Icons.
    p.FillRect(unit, (2.0 + 6.0 * i) * unit, 3.0 * unit, 3.0 * unit, p.AnyColor());
    p.FillRect(unit * 1.5, (2.6 + 6.0 * i) * unit, 1.2 * unit, 1.4 * unit, p.AnyColor());
  }
  for (int i = 0; i < 4; ++i) {  // Windows.
    const double w = p.width() * rng.Uniform(0.3, 0.55);
    const double h = p.height() * rng.Uniform(0.35, 0.6);
    const double x = rng.Uniform(5.0 * unit, p.width() - w);
    const double y = rng.Uniform(0.0, p.height() - h);
    const bool dark = rng.Below(3) == 0;
    p.FillRect(x, y, w, h, p.Vary(dark ? cv::Scalar::all(40.0) : cv::Scalar::all(230.0), 15.0));
    p.FillRect(x, y, w, 1.8 * unit, p.AnyColor());
    const cv::Rect text(static_cast<int>(x + unit), static_cast<int>(y + 2.5 * unit),
                        static_cast<int>(w - 2.0 * unit), static_cast<int>(h - 4.0 * unit));
    p.AddText(text, unit, dark ? cv::Scalar(170, 220, 170) : cv::Scalar::all(30.0));
    if (rng.Below(2) == 0) {
      p.FillRect(x + 0.5 * w, y + 0.4 * h, 0.4 * w, 0.4 * h, p.AnyColor());
      p.FillRect(x + 0.6 * w, y + 0.5 * h, 0.1 * w, 0.2 * h, p.AnyColor());
    }
  }
}

void PaintWood(Painter& p) {
  Rng& rng = p.rng();
  // Boards along u with staggered ends.
  const double board = std::min<double>(p.height(), p.m(rng.Uniform(0.1, 0.15)));
  for (double y = 0.0; y < p.height(); y += board) {
    double x = -p.m(rng.Uniform(0.0, 0.8));
    while (x < p.width()) {
      const double length = p.m(rng.Uniform(0.5, 1.2));
      p.FillRect(x, y, length - 1.0, board - 1.0, p.Vary(p.Mix(rng.Uniform(0.0, 0.45)), 12.0));
      p.FillRect(x + length - 1.0, y, 1.0, board, p.Mix(1.0));
      x += length;
    }
    p.FillRect(0.0, y + board - 1.0, p.width(), 1.0, p.Mix(1.1));
  }
  p.AddNoise(p.m(0.2), p.m(0.008), 14.0);
  p.AddNoise(p.m(0.08), p.m(0.004), 12.0);
  p.AddNoiseOctaves(24.0, 4.0);
  // Knots, dents and stains.
  p.AddSoftBlobs(18.0, 0.004, 0.02, 60.0);
  p.AddFlecks(160.0, 0.003, 0.02, 60.0);
  p.AddCracks(4.0, 0.15, 45.0);
}

void PaintFabric(Painter& p) {
  p.AddMottling(p.m(0.16));
  p.AddFlecks(250.0, 0.006, 0.05, 70.0);
  p.AddNoise(2.0, 6.0, 8.0);
  p.AddNoise(6.0, 2.0, 8.0);
}

void PaintPlaster(Painter& p) {
  p.AddNoiseOctaves(p.m(0.6), 5.0);
  p.AddSoftBlobs(3.0, 0.02, 0.12, 22.0);
  p.AddFlecks(60.0, 0.006, 0.05, 55.0);
  p.AddCracks(2.5, 0.5, 50.0);
}

void PaintBrick(Painter& p) {
  Rng& rng = p.rng();
  p.Fill(p.Mix(0.9));
  const double w = p.m(0.21);
  const double h = p.m(0.07);
  const double gap = std::max(1.0, p.m(0.01));
  int row = 0;
  for (double y = 0.0; y < p.height(); y += h, ++row) {
    double x = -(row % 2) * 0.5 * w - p.m(rng.Uniform(0.0, 0.05));
    while (x < p.width()) {
      const double length = w * rng.Uniform(0.85, 1.12);
      p.FillRect(x, y, length - gap, h - gap, p.Vary(p.Mix(rng.Uniform(0.0, 0.8)), 30.0));
      x += length;
    }
  }
  p.AddNoiseOctaves(p.m(0.5), 5.0);
  p.AddFlecks(120.0, 0.005, 0.03, 60.0);
}

void PaintTiles(Painter& p) {
  Rng& rng = p.rng();
  p.Fill(p.secondary());
  const double size = p.m(rng.Uniform(0.18, 0.3));
  const double gap = std::max(1.0, p.m(0.006));
  for (double y = 0.0; y < p.height(); y += size) {
    for (double x = 0.0; x < p.width(); x += size) {
      p.FillRect(x, y, size - gap, size - gap, p.Vary(p.Mix(rng.Uniform(0.0, 0.35)), 16.0));
    }
  }
  p.AddNoiseOctaves(p.m(0.4), 5.0);
  p.AddCracks(14.0, 0.2, 55.0);
  p.AddFlecks(90.0, 0.005, 0.035, 55.0);
}

}  // namespace s3lam::synthetic
