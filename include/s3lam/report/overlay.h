#pragma once

#include <opencv2/core/mat.hpp>
#include <span>
#include <unordered_map>

#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// The row of each point in the tables of a semantic map.
using RowOfPoint = std::unordered_map<PointId, size_t>;
RowOfPoint RowsOfPoints(const SemanticMap& map);

struct OverlayOptions {
  double scale = 1.0;            // Of the picture relative to the image whose keypoints are given.
  double keypoint_radius = 2.5;  // px of the picture
  int min_plane_observations =
      5;                       // Planes of which the image observes fewer inliers are not drawn.
  double arrow_length = 0.12;  // Of a normal, relative to its distance from the camera.
  double axis_length = 0.06;   // Of an axis in the plane, likewise.
};

/// Draws, into a BGR picture of the image: a dot in the colour of its point's class for every
/// keypoint that observes a clustered point (small and grey for other observed points), and for
/// each plane the image observes its outline and, from the middle of the observed inliers, its
/// normal and its axes. Planes are in the world of `image.cam_from_world`.
void DrawOverlay(const Camera& camera, const Image& image, const SemanticMap& map,
                 const RowOfPoint& rows, std::span<const PlanarSurface> planes,
                 const Reconstruction& model, const OverlayOptions& options, cv::Mat& picture);

}  // namespace s3lam
