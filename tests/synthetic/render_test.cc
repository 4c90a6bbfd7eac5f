#include "s3lam/synthetic/render.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "s3lam/base/rng.h"
#include "s3lam/base/statistics.h"
#include "s3lam/synthetic/ray_cast.h"

namespace s3lam {
namespace {

bool SameBytes(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && a.isContinuous() && b.isContinuous() &&
         std::equal(a.data, a.data + a.total() * a.elemSize(), b.data);
}

cv::Mat Gray(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

// Where a pixel (centre of the first one at 0.5) of frame a lies in frame b.
std::optional<Eigen::Vector2d> PixelInOther(const Scene& scene, const RenderedFrame& a,
                                            const RenderedFrame& b, const Eigen::Vector2d& pixel) {
  const double depth = a.depth.at<float>(static_cast<int>(pixel.y()), static_cast<int>(pixel.x()));
  if (depth <= 0.0) return std::nullopt;
  const Eigen::Vector3d ray = scene.camera.CameraFromImage(pixel)->homogeneous();
  return scene.camera.ImageFromCamera(b.world_from_camera.Inverse() *
                                      (a.world_from_camera * (depth * ray)));
}

TEST(Renderer, GivesTheSameBytesForAnyNumberOfThreads) {
  const Scene scene = MakeScene("desk", 3);
  const Renderer one(scene, 1);
  const Renderer three(scene, 3);
  const RenderedFrame a = one.Render(7);
  const RenderedFrame b = three.Render(7);
  EXPECT_TRUE(SameBytes(a.image, b.image));
  EXPECT_TRUE(SameBytes(a.labels, b.labels));
  EXPECT_TRUE(SameBytes(a.depth, b.depth));
  EXPECT_TRUE(SameBytes(a.image, one.Render(7).image));
  EXPECT_FALSE(SameBytes(a.image, one.Render(8).image));
  const Scene other = MakeScene("desk", 4);
  EXPECT_FALSE(SameBytes(a.image, Renderer(other, 1).Render(7).image));
}

class EveryScene : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Renderer, EveryScene, testing::ValuesIn(SceneNames()),
                         [](const auto& scene) { return scene.param; });

TEST_P(EveryScene, LabelsAndDepthAgreeWithRayCasting) {
  const Scene scene = MakeScene(GetParam(), 1);
  const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
  const RayCaster caster(scene);
  const RenderedFrame frame = renderer.RenderLabels(scene.num_frames / 2);
  Rng rng(5);
  int same = 0;
  constexpr int kRays = 2000;
  for (int i = 0; i < kRays; ++i) {
    const int x = static_cast<int>(rng.Below(static_cast<uint64_t>(scene.camera.width)));
    const int y = static_cast<int>(rng.Below(static_cast<uint64_t>(scene.camera.height)));
    const Eigen::Vector3d ray = scene.camera.CameraFromImage({x + 0.5, y + 0.5})->homogeneous();
    const auto hit =
        caster.Cast(frame.world_from_camera.translation, frame.world_from_camera.rotation * ray);
    const int label = frame.labels.at<int>(y, x);
    if (!hit) {
      same += label == 0 ? 1 : 0;
      continue;
    }
    const int object = scene.surfaces[static_cast<size_t>(hit->surface)].object;
    const bool agrees = label == scene.objects[static_cast<size_t>(object)].id &&
                        std::abs(frame.depth.at<float>(y, x) - hit->depth) < 1e-3 * hit->depth;
    same += agrees ? 1 : 0;
  }
  // Single precision decides rays through an edge differently now and then.
  EXPECT_GE(same, kRays - 10) << same;
}

TEST_P(EveryScene, FlatSurfacesAreFlatInDepth) {
  const Scene scene = MakeScene(GetParam(), 2);
  const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
  const RenderedFrame frame = renderer.RenderLabels(0);
  std::vector<int> pixels(scene.objects.size() + 1, 0);
  std::vector<int> on_plane(scene.objects.size() + 1, 0);
  for (int y = 0; y < frame.labels.rows; y += 3) {
    for (int x = 0; x < frame.labels.cols; x += 3) {
      const int label = frame.labels.at<int>(y, x);
      if (label == 0) continue;
      const SceneObject& object = scene.objects[static_cast<size_t>(label - 1)];
      if (!object.plane_in_world) continue;
      const Eigen::Vector3d ray = scene.camera.CameraFromImage({x + 0.5, y + 0.5})->homogeneous();
      const double depth = frame.depth.at<float>(y, x);
      const Eigen::Vector3d point = frame.world_from_camera * (depth * ray);
      ++pixels[static_cast<size_t>(label)];
      on_plane[static_cast<size_t>(label)] +=
          std::abs(object.plane_in_world->SignedDistance(point)) < object.flatness_m + 2e-4 * depth
              ? 1
              : 0;
    }
  }
  // Walls and floors are nothing but their plane.
  int checked = 0;
  for (const SceneObject& object : scene.objects) {
    const auto i = static_cast<size_t>(object.id);
    const bool pure = object.name.starts_with("wall") || object.name == "floor" ||
                      object.name == "sheet" || object.name == "picture" || object.name == "road";
    if (!pure || pixels[i] < 100) continue;
    // The road's paint lies a little above it.
    EXPECT_GE(on_plane[i], 0.97 * pixels[i]) << object.name;
    ++checked;
  }
  EXPECT_GE(checked, 1);
}

TEST_P(EveryScene, ImagesMoveAsTheGeometrySays) {
  const Scene scene = MakeScene(GetParam(), 1);
  const Renderer renderer(scene, 2);
  const int first = scene.num_frames / 3;
  const RenderedFrame a = renderer.Render(first);
  const RenderedFrame b = renderer.Render(first + 3);
  const cv::Mat gray_a = Gray(a.image);
  const cv::Mat gray_b = Gray(b.image);
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(gray_a, corners, 600, 0.01, 8.0);
  EXPECT_GE(corners.size(), 350u);
  constexpr int kHalf = 7;
  constexpr int kSearch = 5;
  int tried = 0;
  int right = 0;
  for (const cv::Point2f& corner : corners) {
    const auto to = PixelInOther(scene, a, b, {corner.x + 0.5, corner.y + 0.5});
    if (!to) continue;
    const cv::Point from(static_cast<int>(corner.x), static_cast<int>(corner.y));
    const cv::Point near(static_cast<int>(to->x()), static_cast<int>(to->y()));
    const cv::Rect inside(0, 0, gray_a.cols, gray_a.rows);
    const cv::Rect patch(from.x - kHalf, from.y - kHalf, 2 * kHalf + 1, 2 * kHalf + 1);
    const cv::Rect window(near.x - kHalf - kSearch, near.y - kHalf - kSearch,
                          2 * (kHalf + kSearch) + 1, 2 * (kHalf + kSearch) + 1);
    if ((patch & inside) != patch || (window & inside) != window) continue;
    cv::Mat score;
    cv::matchTemplate(gray_b(window), gray_a(patch), score, cv::TM_CCOEFF_NORMED);
    cv::Point best;
    cv::minMaxLoc(score, nullptr, nullptr, nullptr, &best);
    ++tried;
    const double error = std::hypot(best.x - kSearch, best.y - kSearch);
    right += error <= 1.5 ? 1 : 0;
  }
  EXPECT_GE(tried, 150);
  // The rest are corners at depth edges, whose surroundings do not move together.
  EXPECT_GE(right, 0.8 * tried) << right << " of " << tried;
}

/// How far what `moved` shows in a window lies from where `still` shows it [px], to first order.
std::optional<Eigen::Vector2d> ShiftOf(const cv::Mat& moved, const cv::Mat& still,
                                       const cv::Rect& window) {
  Eigen::Matrix2d hessian = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  for (int y = window.y; y < window.br().y; ++y) {
    for (int x = window.x; x < window.br().x; ++x) {
      const Eigen::Vector2d slope(moved.at<uint8_t>(y, x + 1) - moved.at<uint8_t>(y, x - 1),
                                  moved.at<uint8_t>(y + 1, x) - moved.at<uint8_t>(y - 1, x));
      hessian += 0.25 * slope * slope.transpose();
      right += 0.5 * slope * (still.at<uint8_t>(y, x) - moved.at<uint8_t>(y, x));
    }
  }
  const double samples = window.area();
  if (hessian.determinant() < 1e3 * samples * samples) return std::nullopt;  // No texture.
  return hessian.inverse() * right;
}

TEST_P(EveryScene, BlurredImagesShowTheMiddleOfTheirExposure) {
  const int kWindow = 32;
  const Scene sharp_scene = MakeScene(GetParam(), 1, {.noise_factor = 0.0, .motion_blur = 0.0});
  const Scene scene = MakeScene(GetParam(), 1, {.noise_factor = 0.0, .motion_blur = 2.0});
  const Renderer renderer(scene, 2);
  const Renderer sharp_renderer(sharp_scene, 2);
  for (const int frame : {0, scene.num_frames / 3}) {
    const cv::Mat blurred = Gray(renderer.Render(frame).image);
    const cv::Mat sharp = Gray(sharp_renderer.Render(frame).image);
    std::vector<double> x, y;
    for (int top = 1; top + kWindow < sharp.rows; top += kWindow) {
      for (int left = 1; left + kWindow < sharp.cols; left += kWindow) {
        const auto shift = ShiftOf(blurred, sharp, {left, top, kWindow, kWindow});
        if (!shift) continue;
        x.push_back(shift->x());
        y.push_back(shift->y());
      }
    }
    ASSERT_GE(x.size(), 20U);
    EXPECT_NEAR(Median(x), 0.0, 0.02) << "frame " << frame;
    EXPECT_NEAR(Median(y), 0.0, 0.02) << "frame " << frame;
  }
}

TEST_P(EveryScene, NeighbouringFramesOverlap) {
  const Scene scene = MakeScene(GetParam(), 3);
  const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
  const bool is_drive = scene.layout == SequenceLayout::kKittiStep;
  for (int first = 0; first + 1 < scene.num_frames; first += scene.num_frames / 5) {
    const RenderedFrame a = renderer.RenderLabels(first);
    const RenderedFrame b = renderer.RenderLabels(first + 1);
    int seen = 0;
    int all = 0;
    for (int y = 4; y < a.depth.rows; y += 16) {
      for (int x = 4; x < a.depth.cols; x += 16) {
        const auto to = PixelInOther(scene, a, b, {x + 0.5, y + 0.5});
        if (!to) continue;
        ++all;
        seen += to->x() > 0.0 && to->y() > 0.0 && to->x() < a.depth.cols && to->y() < a.depth.rows
                    ? 1
                    : 0;
      }
    }
    EXPECT_GT(seen, (is_drive ? 0.7 : 0.9) * all) << "frame " << first;
  }
}

TEST(Renderer, RoomComesBackToItsStart) {
  const Scene scene = MakeScene("room", 1);
  const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
  const RenderedFrame start = renderer.RenderLabels(0);
  double best = 0.0;
  for (int frame = 2 * scene.num_frames / 3; frame < scene.num_frames; frame += 10) {
    const RenderedFrame late = renderer.RenderLabels(frame);
    int seen = 0;
    int all = 0;
    for (int y = 4; y < start.depth.rows; y += 16) {
      for (int x = 4; x < start.depth.cols; x += 16, ++all) {
        const auto to = PixelInOther(scene, start, late, {x + 0.5, y + 0.5});
        if (!to || to->x() < 1.0 || to->y() < 1.0 || to->x() > start.depth.cols - 1 ||
            to->y() > start.depth.rows - 1) {
          continue;
        }
        // The same object there, so it is really seen and not hidden.
        seen += late.labels.at<int>(static_cast<int>(to->y()), static_cast<int>(to->x())) ==
                        start.labels.at<int>(y, x)
                    ? 1
                    : 0;
      }
    }
    best = std::max(best, static_cast<double>(seen) / all);
  }
  EXPECT_GT(best, 0.7);
}

TEST(Renderer, NoiseAndBlurFollowTheirOptions) {
  SceneOptions quiet;
  quiet.noise_factor = 0.0;
  SceneOptions noisy;
  noisy.noise_factor = 4.0;
  const Scene quiet_scene = MakeScene("posters", 1, quiet);
  const Scene noisy_scene = MakeScene("posters", 1, noisy);
  const cv::Mat a = Renderer(quiet_scene, 2).Render(5).image;
  const cv::Mat b = Renderer(noisy_scene, 2).Render(5).image;
  cv::Mat difference;
  cv::absdiff(a, b, difference);
  // Mean of |N(0, s)| is 0.8 s, with s = 8 at mid gray and less in the dark.
  EXPECT_NEAR(cv::mean(Gray(difference))[0], 5.5, 2.0);
}

TEST(Renderer, ARollingShutterExposesEachRowInItsTurn) {
  constexpr double kReadout = 0.04;
  constexpr int kFrame = 20;
  SceneOptions quiet;
  quiet.noise_factor = 0.0;
  SceneOptions rolling = quiet;
  rolling.readout_s = kReadout;
  Scene rolling_scene = MakeScene("posters", 1, rolling);
  rolling_scene.imaging.exposure_swing = 0.0;
  const RenderedFrame rolled = Renderer(rolling_scene, 2).Render(kFrame);
  const int height = rolled.image.rows;
  for (const int row : {2, height / 2, height - 3}) {
    // The whole image as of when that row was exposed.
    Scene scene = MakeScene("posters", 1, quiet);
    const double time_s = scene.TimeOf(kFrame) + ((row + 0.5) / height - 0.5) * kReadout;
    scene.fps = kFrame / time_s;
    scene.imaging.exposure_swing = 0.0;
    const RenderedFrame still = Renderer(scene, 2).Render(kFrame);
    const int far_row = row < height / 2 ? height - 3 : 2;
    for (const auto content : {&RenderedFrame::depth, &RenderedFrame::image}) {
      const auto distance = [&](int other_row) {
        return cv::norm((rolled.*content).row(other_row), (still.*content).row(other_row),
                        cv::NORM_L1);
      };
      EXPECT_LT(distance(row), 0.4 * distance(far_row)) << row;
    }
  }
  EXPECT_EQ(rolled.world_from_camera.translation,
            rolling_scene.WorldFromCamera(kFrame).translation);
}

}  // namespace
}  // namespace s3lam
