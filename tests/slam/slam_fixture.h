#pragma once

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "s3lam/base/rng.h"
#include "s3lam/slam/features.h"
#include "support/test_scene.h"

namespace s3lam::testing {

/// An image of overlapping rectangles in random grays, slightly blurred: corners everywhere.
inline cv::Mat MakeTexture(int width, int height, uint64_t seed) {
  Rng rng(seed);
  cv::Mat image(height, width, CV_8UC1, cv::Scalar(128));
  const int count = width * height / 400;
  for (int i = 0; i < count; ++i) {
    const cv::Point corner(static_cast<int>(rng.Below(static_cast<uint64_t>(width))),
                           static_cast<int>(rng.Below(static_cast<uint64_t>(height))));
    const cv::Size size(4 + static_cast<int>(rng.Below(40)), 4 + static_cast<int>(rng.Below(40)));
    cv::rectangle(image, cv::Rect(corner, size), cv::Scalar(static_cast<double>(rng.Below(256))),
                  cv::FILLED);
  }
  cv::GaussianBlur(image, image, cv::Size(3, 3), 0.8);
  return image;
}

/// A random descriptor.
inline BinaryDescriptor MakeDescriptor(Rng& rng) {
  BinaryDescriptor descriptor;
  for (uint8_t& byte : descriptor) byte = static_cast<uint8_t>(rng.Below(256));
  return descriptor;
}

/// Points with descriptors, seen by a camera: features without any image.
struct PointCloud {
  std::vector<Eigen::Vector3d> points;
  std::vector<BinaryDescriptor> descriptors;
};

inline PointCloud MakeCloud(int count, bool planar, uint64_t seed) {
  Rng rng(seed);
  PointCloud cloud;
  for (int i = 0; i < count; ++i) {
    const double x = rng.Uniform(-3, 3);
    const double y = rng.Uniform(-2, 2);
    cloud.points.emplace_back(x, y, planar ? 4.0 + 0.2 * y : rng.Uniform(2.5, 7.0));
    cloud.descriptors.push_back(MakeDescriptor(rng));
  }
  return cloud;
}

inline FrameFeatures SeeCloud(const PointCloud& cloud, const Rigid3& cam_from_world,
                              const Undistorter& undistorter, double noise_px, Rng& rng) {
  std::vector<Keypoint> keypoints;
  std::vector<BinaryDescriptor> descriptors;
  const Camera& camera = undistorter.camera();
  for (size_t i = 0; i < cloud.points.size(); ++i) {
    const auto pixel = camera.ImageFromCamera(cam_from_world * cloud.points[i]);
    if (!pixel || pixel->x() < 0 || pixel->y() < 0 || pixel->x() > camera.width ||
        pixel->y() > camera.height) {
      continue;
    }
    const Eigen::Vector2d noisy =
        *pixel + noise_px * Eigen::Vector2d(rng.Gaussian(), rng.Gaussian());
    const auto undistorted = undistorter.Undistort(noisy);
    if (!undistorted) continue;
    Keypoint keypoint;
    keypoint.pixel = noisy.cast<float>();
    keypoint.undistorted = undistorted->cast<float>();
    keypoints.push_back(keypoint);
    descriptors.push_back(cloud.descriptors[i]);
  }
  return {std::move(keypoints), std::move(descriptors), undistorter};
}

}  // namespace s3lam::testing
