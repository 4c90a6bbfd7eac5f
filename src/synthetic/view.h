#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "s3lam/geometry/camera.h"
#include "s3lam/geometry/rigid3.h"
#include "s3lam/synthetic/scene.h"

namespace s3lam::synthetic {

/// The ray (x, y, 1) of every pixel, row by row, through one point of the pixel.
struct RayTable {
  int width = 0;
  int height = 0;
  std::vector<float> x, y;
  // Range of x in each column and of y in each row, one pixel wider on either side.
  std::vector<float> column_min, column_max, row_min, row_max;
};

/// Rays through the pixels' centres.
RayTable MakeRayTable(const Camera& camera, int num_threads);
/// The same table for points shifted by (dx, dy) px, to first order; exact to 1e-5 px for shifts
/// within a pixel and any sensible distortion.
RayTable ShiftRayTable(const RayTable& table, double dx, double dy);

/// A surface's texture: size of the painted rectangle (m) and the texture coordinates' origin.
struct TextureFrame {
  Eigen::Vector2d size_m = Eigen::Vector2d::Ones();
  Eigen::Vector2d origin_m = Eigen::Vector2d::Zero();  // Smallest u and v.
};
TextureFrame TextureFrameOf(const Surface& surface);

/// In-plane unit axes of a polygon's texture coordinates.
std::array<Eigen::Vector3d, 2> PolygonAxes(const Surface& surface);

/// What a surface looks like from one camera pose: pixel window, and per ray r = (x, y, 1) the
/// inverse depth and whether the ray hits.
struct PreparedPolygon {
  int surface = 0;
  int x_begin = 0, x_end = 0, y_begin = 0, y_end = 0;
  Eigen::Vector3f inverse_depth;         // . r
  std::array<Eigen::Vector3f, 4> edges;  // . r >= 0 inside; unused ones repeat the last.
};
struct PreparedCurved {
  int surface = 0;
  int x_begin = 0, x_end = 0, y_begin = 0, y_end = 0;
  // Azimuths allowed: those within an angle of a direction, by the cosine of that angle.
  double middle_x = 1.0, middle_y = 0.0, cos_reach = -2.0;
  // The ray in the unit shape's frame: origin + depth * (matrix * r).
  Eigen::Vector3d origin;
  Eigen::Matrix3d matrix;
};

/// All surfaces that may be visible in one pose.
struct View {
  Rigid3 cam_from_world;
  std::vector<PreparedPolygon> polygons;
  std::vector<PreparedCurved> curved;
};
View PrepareView(const Scene& scene, const RayTable& rays, const Rigid3& cam_from_world);

/// Depth at which a ray meets a curved surface, and the point in the unit shape's frame; 0 if it
/// does not.
double HitCurved(const Surface& surface, const PreparedCurved& prepared, const Eigen::Vector3d& ray,
                 Eigen::Vector3d& local);

/// Inverse depth and index of the nearest surface (-1: none) for rows [row_begin, row_end) of the
/// image; both arrays start at row_begin.
void FindVisible(const Scene& scene, const RayTable& rays, const View& view, int row_begin,
                 int row_end, float* inverse_depth, int* surface);

}  // namespace s3lam::synthetic
