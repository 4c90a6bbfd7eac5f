#include "painter.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

namespace s3lam::synthetic {
namespace {

cv::Scalar BgrOf(const Rgb& rgb) { return {double(rgb[2]), double(rgb[1]), double(rgb[0])}; }

}  // namespace

Painter::Painter(const TextureSpec& spec, cv::Size size, double texels_per_m)
    : image_(size, CV_8UC3),
      texels_per_m_(texels_per_m),
      rng_(spec.seed),
      primary_(BgrOf(spec.primary)),
      secondary_(BgrOf(spec.secondary)) {
  image_.setTo(primary_);
}

double Painter::AreaM2() const {
  return width() * double(height()) / (texels_per_m_ * texels_per_m_);
}

cv::Scalar Painter::Mix(double share) const {
  return primary_ * (1.0 - share) + secondary_ * share;
}

cv::Scalar Painter::AnyColor() {
  return {rng_.Uniform(15.0, 240.0), rng_.Uniform(15.0, 240.0), rng_.Uniform(15.0, 240.0)};
}

cv::Scalar Painter::Vary(const cv::Scalar& color, double amount) {
  return color + cv::Scalar::all(rng_.Uniform(-amount, amount));
}

void Painter::Fill(const cv::Scalar& color) { image_.setTo(color); }

cv::Mat Painter::RandomGrid(cv::Size size, double amplitude) {
  cv::Mat grid(size, CV_32F);
  for (int y = 0; y < grid.rows; ++y) {
    for (int x = 0; x < grid.cols; ++x) {
      grid.at<float>(y, x) = static_cast<float>(amplitude * rng_.Uniform(-1.0, 1.0));
    }
  }
  return grid;
}

// Each octave is added to the enlarged sum of the coarser ones, so that only the finest is handled
// at nearly full size.
cv::Mat Painter::OctaveNoise(double largest, double smallest, double growth) {
  cv::Mat sum;
  double amplitude = 1.0;
  for (double cell = largest; sum.empty() || cell >= smallest; cell *= 0.5) {
    const cv::Size size(static_cast<int>(std::ceil(width() / cell)) + 1,
                        static_cast<int>(std::ceil(height() / cell)) + 1);
    const cv::Mat grid = RandomGrid(size, amplitude);
    if (sum.empty()) {
      sum = grid;
    } else {
      cv::Mat enlarged;
      cv::resize(sum, enlarged, size, 0.0, 0.0, cv::INTER_CUBIC);
      sum = enlarged + grid;
    }
    amplitude *= growth;
  }
  cv::Mat full;
  cv::resize(sum, full, image_.size(), 0.0, 0.0, cv::INTER_CUBIC);
  return full;
}

void Painter::Add(const cv::Mat& noise, double gain) {
  const auto factor = static_cast<float>(gain);
  for (int y = 0; y < height(); ++y) {
    auto* row = image_.ptr<cv::Vec3b>(y);
    const auto* value = noise.ptr<float>(y);
    for (int x = 0; x < width(); ++x) {
      const int add = static_cast<int>(factor * value[x] + 512.5F) - 512;  // Rounds.
      for (int k = 0; k < 3; ++k) row[x][k] = cv::saturate_cast<uint8_t>(row[x][k] + add);
    }
  }
}

void Painter::AddNoise(double cell_x, double cell_y, double amplitude) {
  const cv::Size size(static_cast<int>(std::ceil(width() / std::max(1.0, cell_x))) + 1,
                      static_cast<int>(std::ceil(height() / std::max(1.0, cell_y))) + 1);
  cv::Mat full;
  cv::resize(RandomGrid(size, 1.0), full, image_.size(), 0.0, 0.0, cv::INTER_CUBIC);
  Add(full, amplitude);
}

void Painter::AddNoiseOctaves(double largest, double amplitude, double growth) {
  constexpr double kSmallest = 1.4;
  Add(OctaveNoise(std::max(largest, kSmallest), kSmallest, growth), amplitude);
}

void Painter::AddMottling(double largest) {
  const cv::Mat sum = OctaveNoise(largest, 2.0, 0.85);
  for (int y = 0; y < height(); ++y) {
    auto* row = image_.ptr<cv::Vec3b>(y);
    const auto* value = sum.ptr<float>(y);
    for (int x = 0; x < width(); ++x) {
      // A steep but not hard threshold, so that edges are band-limited.
      const double share = std::clamp(0.5 + 2.5 * value[x], 0.0, 1.0);
      const cv::Scalar color = Mix(share);
      for (int k = 0; k < 3; ++k) row[x][k] = cv::saturate_cast<uint8_t>(color[k]);
    }
  }
}

void Painter::AddFlecks(double count_per_m2, double min_m, double max_m, double contrast) {
  constexpr int kShift = 4;  // Sixteenths of a texel.
  const int count = static_cast<int>(std::lround(count_per_m2 * AreaM2()));
  for (int i = 0; i < count; ++i) {
    const double size = m(min_m * std::pow(max_m / min_m, rng_.Uniform()));
    const cv::Point2d center(rng_.Uniform(0.0, width()), rng_.Uniform(0.0, height()));
    const int corners = 3 + static_cast<int>(rng_.Below(3));
    const double turn = rng_.Uniform(0.0, 2.0 * std::numbers::pi);
    std::vector<cv::Point> outline;
    for (int k = 0; k < corners; ++k) {
      const double angle = turn + 2.0 * std::numbers::pi * (k + rng_.Uniform(0.0, 0.5)) / corners;
      const double radius = size * rng_.Uniform(0.35, 1.0);
      outline.emplace_back(static_cast<int>((center.x + radius * std::cos(angle)) * (1 << kShift)),
                           static_cast<int>((center.y + radius * std::sin(angle)) * (1 << kShift)));
    }
    const double tone = (rng_.Below(2) == 0 ? -1.0 : 1.0) * rng_.Uniform(0.4, 1.0) * contrast;
    const auto x = std::clamp(static_cast<int>(center.x), 0, width() - 1);
    const auto y = std::clamp(static_cast<int>(center.y), 0, height() - 1);
    const cv::Vec3b under = image_.at<cv::Vec3b>(y, x);
    const cv::Scalar color(under[0] + tone, under[1] + tone, under[2] + tone);
    cv::fillConvexPoly(image_, outline, color, cv::LINE_AA, kShift);
  }
}

void Painter::AddCracks(double count_per_m2, double length_m, double contrast) {
  const int count = static_cast<int>(std::lround(count_per_m2 * AreaM2()));
  for (int i = 0; i < count; ++i) {
    cv::Point2d at(rng_.Uniform(0.0, width()), rng_.Uniform(0.0, height()));
    double angle = rng_.Uniform(0.0, 2.0 * std::numbers::pi);
    const double step = std::max(3.0, m(length_m) / 12.0);
    const cv::Scalar color = Vary(Mix(0.5), contrast);
    for (int k = 0; k < 12; ++k) {
      const cv::Point2d next(at.x + step * std::cos(angle), at.y + step * std::sin(angle));
      cv::line(image_, at, next, color, 1 + static_cast<int>(rng_.Below(2)), cv::LINE_AA);
      at = next;
      angle += rng_.Gaussian(0.0, 0.6);
    }
  }
}

void Painter::AddSoftBlobs(double count_per_m2, double min_m, double max_m, double contrast) {
  const int count = static_cast<int>(std::lround(count_per_m2 * AreaM2()));
  for (int i = 0; i < count; ++i) {
    const double size = m(rng_.Uniform(min_m, max_m));
    const cv::Point center(static_cast<int>(rng_.Uniform(0.0, width())),
                           static_cast<int>(rng_.Uniform(0.0, height())));
    const cv::Size axes(std::max(1, static_cast<int>(size)),
                        std::max(1, static_cast<int>(size * rng_.Uniform(0.4, 1.0))));
    const cv::Vec3b under = image_.at<cv::Vec3b>(std::clamp(center.y, 0, height() - 1),
                                                 std::clamp(center.x, 0, width() - 1));
    cv::ellipse(image_, center, axes, rng_.Uniform(0.0, 180.0), 0.0, 360.0,
                Vary(cv::Scalar(under[0], under[1], under[2]), contrast), cv::FILLED, cv::LINE_AA);
  }
}

std::string Painter::RandomWord() {
  static constexpr char kLetters[] = "ABCDEFGHJKLMNPRSTUVWXYZabdefghkmnqrst2345678&%#?";
  std::string word;
  const size_t length = 2 + rng_.Below(7);
  for (size_t i = 0; i < length; ++i) word += kLetters[rng_.Below(sizeof(kLetters) - 1)];
  return word;
}

void Painter::AddText(const cv::Rect& box, double letter_height, const cv::Scalar& color) {
  const cv::Rect inside = box & cv::Rect(0, 0, width(), height());
  if (inside.width < 4 || inside.height < 4 || letter_height < 3.0) return;
  cv::Mat area = image_(inside);
  const double scale = letter_height / 21.0;  // Hershey letters are 21 units high.
  const int thickness = std::max(1, static_cast<int>(std::lround(letter_height / 8.0)));
  const int font = rng_.Below(2) == 0 ? cv::FONT_HERSHEY_SIMPLEX : cv::FONT_HERSHEY_TRIPLEX;
  for (double y = 1.15 * letter_height; y < inside.height; y += 1.6 * letter_height) {
    double x = 0.0;
    const double end = inside.width * rng_.Uniform(0.6, 1.0);  // Ragged right.
    while (x < end) {
      const std::string word = RandomWord();
      cv::putText(area, word, cv::Point(static_cast<int>(x), static_cast<int>(y)), font, scale,
                  color, thickness, cv::LINE_AA);
      x += cv::getTextSize(word, font, scale, thickness, nullptr).width + 0.6 * letter_height;
    }
  }
}

void Painter::FillRect(double x, double y, double w, double h, const cv::Scalar& color) {
  const cv::Rect rect(static_cast<int>(std::lround(x)), static_cast<int>(std::lround(y)),
                      std::max(1, static_cast<int>(std::lround(w))),
                      std::max(1, static_cast<int>(std::lround(h))));
  cv::rectangle(image_, rect, color, cv::FILLED);
}

}  // namespace s3lam::synthetic
