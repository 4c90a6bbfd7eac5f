#include "view.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "s3lam/base/error.h"
#include "s3lam/base/parallel.h"
#include "s3lam/synthetic/ray_cast.h"

namespace s3lam::synthetic {
namespace {

constexpr double kNear_m = 0.02;

void FindRanges(RayTable& table) {
  const float margin = table.width > 1 ? std::abs(table.x[1] - table.x[0]) : 0.01F;
  table.column_min.assign(static_cast<size_t>(table.width), 1e30F);
  table.column_max.assign(static_cast<size_t>(table.width), -1e30F);
  table.row_min.assign(static_cast<size_t>(table.height), 1e30F);
  table.row_max.assign(static_cast<size_t>(table.height), -1e30F);
  for (size_t row = 0; row < static_cast<size_t>(table.height); ++row) {
    for (size_t column = 0; column < static_cast<size_t>(table.width); ++column) {
      const size_t i = row * static_cast<size_t>(table.width) + column;
      table.column_min[column] = std::min(table.column_min[column], table.x[i] - margin);
      table.column_max[column] = std::max(table.column_max[column], table.x[i] + margin);
      table.row_min[row] = std::min(table.row_min[row], table.y[i] - margin);
      table.row_max[row] = std::max(table.row_max[row], table.y[i] + margin);
    }
  }
}

// Polygon cut off at the near plane.
std::vector<Eigen::Vector3d> ClipNear(const std::vector<Eigen::Vector3d>& corners) {
  std::vector<Eigen::Vector3d> clipped;
  for (size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector3d& a = corners[i];
    const Eigen::Vector3d& b = corners[(i + 1) % corners.size()];
    if (a.z() >= kNear_m) clipped.push_back(a);
    if ((a.z() >= kNear_m) != (b.z() >= kNear_m)) {
      clipped.push_back(a + (kNear_m - a.z()) / (b.z() - a.z()) * (b - a));
    }
  }
  return clipped;
}

struct Window {
  int x_begin = 0, x_end = 0, y_begin = 0, y_end = 0;
};

// The pixels whose rays may lie within [low, high]; per axis an interval, as the ranges increase.
std::pair<int, int> Interval(const std::vector<float>& min, const std::vector<float>& max,
                             double low, double high) {
  const auto begin = std::lower_bound(max.begin(), max.end(), static_cast<float>(low));
  const auto end = std::upper_bound(min.begin(), min.end(), static_cast<float>(high));
  return {static_cast<int>(begin - max.begin()), static_cast<int>(end - min.begin())};
}

std::optional<Window> WindowOf(const RayTable& rays, const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector2d low = Eigen::Vector2d::Constant(1e30);
  Eigen::Vector2d high = Eigen::Vector2d::Constant(-1e30);
  for (const Eigen::Vector3d& point : points) {
    low = low.cwiseMin(point.hnormalized());
    high = high.cwiseMax(point.hnormalized());
  }
  Window window;
  std::tie(window.x_begin, window.x_end) =
      Interval(rays.column_min, rays.column_max, low.x(), high.x());
  std::tie(window.y_begin, window.y_end) = Interval(rays.row_min, rays.row_max, low.y(), high.y());
  if (window.x_begin >= window.x_end || window.y_begin >= window.y_end) return std::nullopt;
  return window;
}

template <typename Prepared>
void SetWindow(const Window& window, Prepared& prepared) {
  prepared.x_begin = window.x_begin;
  prepared.x_end = window.x_end;
  prepared.y_begin = window.y_begin;
  prepared.y_end = window.y_end;
}

void PreparePolygon(const RayTable& rays, const Surface& surface, int index, View& view) {
  std::vector<Eigen::Vector3d> corners;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& corner : surface.corners) {
    corners.push_back(view.cam_from_world * corner);
    middle += corners.back() / static_cast<double>(surface.corners.size());
  }
  const Eigen::Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
  const double offset = -normal.dot(corners[0]);
  if (std::abs(offset) < 1e-9 * normal.norm()) return;  // Seen exactly from its edge.
  const std::vector<Eigen::Vector3d> clipped = ClipNear(corners);
  if (clipped.size() < 3) return;
  const std::optional<Window> window = WindowOf(rays, clipped);
  if (!window) return;
  PreparedPolygon prepared;
  prepared.surface = index;
  SetWindow(*window, prepared);
  prepared.inverse_depth = (-normal / offset).cast<float>();
  for (size_t i = 0; i < 4; ++i) {
    const size_t k = std::min(i, corners.size() - 1);
    // The plane through the camera and the edge; all of the polygon lies on one side of it.
    Eigen::Vector3d edge = corners[k].cross(corners[(k + 1) % corners.size()]);
    edge *= (edge.dot(middle) < 0.0 ? -1.0 : 1.0) / std::max(1e-12, edge.norm());
    prepared.edges[i] = edge.cast<float>();
  }
  view.polygons.push_back(prepared);
}

void PrepareCurved(const RayTable& rays, const Surface& surface, int index, View& view) {
  std::vector<Eigen::Vector3d> points;
  for (const Eigen::Vector3d& point : BoundingPoints(surface)) {
    points.push_back(view.cam_from_world * point);
    points.back().z() = std::max(points.back().z(), kNear_m);  // Widens the window, never narrows.
  }
  if (std::all_of(points.begin(), points.end(),
                  [](const Eigen::Vector3d& point) { return point.z() <= kNear_m; })) {
    return;
  }
  const std::optional<Window> window = WindowOf(rays, points);
  if (!window) return;
  PreparedCurved prepared;
  prepared.surface = index;
  SetWindow(*window, prepared);
  const double reach = 0.5 * (surface.angle_max - surface.angle_min);
  if (reach < std::numbers::pi) {
    const double middle = 0.5 * (surface.angle_max + surface.angle_min);
    prepared.middle_x = std::cos(middle);
    prepared.middle_y = std::sin(middle);
    prepared.cos_reach = std::cos(reach);
  }
  const Rigid3 local_from_cam = surface.world_from_local.Inverse() * view.cam_from_world.Inverse();
  const Eigen::Vector3d inverse_radii = surface.radii.cwiseInverse();
  prepared.origin = inverse_radii.cwiseProduct(local_from_cam.translation);
  prepared.matrix = inverse_radii.asDiagonal() * local_from_cam.rotation.toRotationMatrix();
  view.curved.push_back(prepared);
}

// One row of one polygon, in a form that compilers vectorise.
void FillRow(const PreparedPolygon& polygon, const float* ray_x, const float* ray_y, int begin,
             int end, float* inverse_depth, int* surface) {
  const Eigen::Vector3f& d = polygon.inverse_depth;
  const Eigen::Vector3f &e0 = polygon.edges[0], &e1 = polygon.edges[1], &e2 = polygon.edges[2],
                        &e3 = polygon.edges[3];
  const float d0 = d[0], d1 = d[1], d2 = d[2];
  const float a0 = e0[0], a1 = e0[1], a2 = e0[2], b0 = e1[0], b1 = e1[1], b2 = e1[2];
  const float c0 = e2[0], c1 = e2[1], c2 = e2[2], g0 = e3[0], g1 = e3[1], g2 = e3[2];
  const int index = polygon.surface;
  for (int i = begin; i < end; ++i) {
    const float x = ray_x[i];
    const float y = ray_y[i];
    const float w = d0 * x + d1 * y + d2;
    const float inside = std::min(std::min(a0 * x + a1 * y + a2, b0 * x + b1 * y + b2),
                                  std::min(c0 * x + c1 * y + c2, g0 * x + g1 * y + g2));
    const bool hit = (inside >= 0.0F) & (w > inverse_depth[i]);
    inverse_depth[i] = hit ? w : inverse_depth[i];
    surface[i] = hit ? index : surface[i];
  }
}

}  // namespace

RayTable MakeRayTable(const Camera& camera, int num_threads) {
  RayTable table;
  table.width = camera.width;
  table.height = camera.height;
  const auto width = static_cast<size_t>(camera.width);
  table.x.resize(width * static_cast<size_t>(camera.height));
  table.y.resize(table.x.size());
  ParallelFor(static_cast<size_t>(camera.height), num_threads, [&](size_t row) {
    for (size_t column = 0; column < width; ++column) {
      const std::optional<Eigen::Vector2d> ray = camera.CameraFromImage(
          {static_cast<double>(column) + 0.5, static_cast<double>(row) + 0.5});
      S3LAM_CHECK_MSG(ray.has_value(), "pixel ({}, {}) has no ray", column, row);
      table.x[row * width + column] = static_cast<float>(ray->x());
      table.y[row * width + column] = static_cast<float>(ray->y());
    }
  });
  FindRanges(table);
  return table;
}

RayTable ShiftRayTable(const RayTable& table, double dx, double dy) {
  RayTable shifted = table;
  const auto slope = [](const std::vector<float>& v, size_t before, size_t after, int steps) {
    return (v[after] - v[before]) / static_cast<float>(std::max(1, steps));
  };
  for (int row = 0; row < table.height; ++row) {
    for (int column = 0; column < table.width; ++column) {
      const auto at = [&](int r, int c) { return static_cast<size_t>(r * table.width + c); };
      const int left = std::max(0, column - 1);
      const int right = std::min(table.width - 1, column + 1);
      const int up = std::max(0, row - 1);
      const int down = std::min(table.height - 1, row + 1);
      for (auto member : {&RayTable::x, &RayTable::y}) {
        const std::vector<float>& v = table.*member;
        (shifted.*member)[at(row, column)] +=
            static_cast<float>(dx) * slope(v, at(row, left), at(row, right), right - left) +
            static_cast<float>(dy) * slope(v, at(up, column), at(down, column), down - up);
      }
    }
  }
  FindRanges(shifted);
  return shifted;
}

std::array<Eigen::Vector3d, 2> PolygonAxes(const Surface& surface) {
  const auto& c = surface.corners;
  const Eigen::Vector3d u = (c[1] - c[0]).normalized();
  const Eigen::Vector3d normal = (c[1] - c[0]).cross(c[2] - c[0]).normalized();
  return {u, normal.cross(u)};
}

TextureFrame TextureFrameOf(const Surface& surface) {
  TextureFrame frame;
  if (surface.shape == SurfaceShape::kPolygon) {
    const auto axes = PolygonAxes(surface);
    Eigen::Vector2d low = Eigen::Vector2d::Zero();
    Eigen::Vector2d high = Eigen::Vector2d::Zero();
    for (const Eigen::Vector3d& corner : surface.corners) {
      const Eigen::Vector3d offset = corner - surface.corners[0];
      const Eigen::Vector2d uv(axes[0].dot(offset), axes[1].dot(offset));
      low = low.cwiseMin(uv);
      high = high.cwiseMax(uv);
    }
    frame.origin_m = low;
    frame.size_m = high - low;
    return frame;
  }
  const double begin = std::max(surface.angle_min, -std::numbers::pi);
  const double end = std::min(surface.angle_max, std::numbers::pi);
  const double girth = std::max(surface.radii.x(), surface.radii.y());
  const double length = surface.shape == SurfaceShape::kCylinder
                            ? (surface.z_max - surface.z_min) * surface.radii.z()
                            : (std::asin(surface.z_max) - std::asin(surface.z_min)) *
                                  std::max(girth, surface.radii.z());
  frame.size_m = Eigen::Vector2d((end - begin) * girth, length);
  return frame;
}

View PrepareView(const Scene& scene, const RayTable& rays, const Rigid3& cam_from_world) {
  View view;
  view.cam_from_world = cam_from_world;
  for (size_t i = 0; i < scene.surfaces.size(); ++i) {
    const Surface& surface = scene.surfaces[i];
    if (surface.shape == SurfaceShape::kPolygon) {
      PreparePolygon(rays, surface, static_cast<int>(i), view);
    } else {
      PrepareCurved(rays, surface, static_cast<int>(i), view);
    }
  }
  return view;
}

double HitCurved(const Surface& surface, const PreparedCurved& prepared, const Eigen::Vector3d& ray,
                 Eigen::Vector3d& local) {
  const Eigen::Vector3d direction = prepared.matrix * ray;
  const Eigen::Vector3d& origin = prepared.origin;
  double a = direction.head<2>().squaredNorm();
  double b = origin.head<2>().dot(direction.head<2>());
  double c = origin.head<2>().squaredNorm() - 1.0;
  if (surface.shape == SurfaceShape::kEllipsoid) {
    a += direction.z() * direction.z();
    b += origin.z() * direction.z();
    c += origin.z() * origin.z();
  }
  const double discriminant = b * b - a * c;
  if (!(discriminant >= 0.0) || a < 1e-300) return 0.0;
  const double root = std::sqrt(discriminant);
  for (const double depth : {(-b - root) / a, (-b + root) / a}) {
    if (depth < kNear_m) continue;
    local = origin + depth * direction;
    if (local.z() < surface.z_min || local.z() > surface.z_max) continue;
    if (prepared.cos_reach > -1.0) {
      const double cosine = prepared.middle_x * local.x() + prepared.middle_y * local.y();
      if (cosine < prepared.cos_reach * std::hypot(local.x(), local.y())) continue;
    }
    return depth;
  }
  return 0.0;
}

void FindVisible(const Scene& scene, const RayTable& rays, const View& view, int row_begin,
                 int row_end, float* inverse_depth, int* surface) {
  constexpr float kFarInverse = 1e-5F;
  const int width = rays.width;
  const auto size = static_cast<size_t>((row_end - row_begin) * width);
  std::fill_n(inverse_depth, size, kFarInverse);
  std::fill_n(surface, size, -1);
  const auto for_rows = [&](const auto& prepared, const auto& body) {
    for (int row = std::max(row_begin, prepared.y_begin); row < std::min(row_end, prepared.y_end);
         ++row) {
      const auto in_table = static_cast<size_t>(row * width);
      const auto in_band = static_cast<size_t>((row - row_begin) * width);
      body(&rays.x[in_table], &rays.y[in_table], inverse_depth + in_band, surface + in_band);
    }
  };
  for (const PreparedPolygon& polygon : view.polygons) {
    for_rows(polygon, [&](const float* x, const float* y, float* w, int* index) {
      FillRow(polygon, x, y, polygon.x_begin, polygon.x_end, w, index);
    });
  }
  Eigen::Vector3d local;
  for (const PreparedCurved& curved : view.curved) {
    const Surface& shape = scene.surfaces[static_cast<size_t>(curved.surface)];
    for_rows(curved, [&](const float* x, const float* y, float* w, int* index) {
      for (int i = curved.x_begin; i < curved.x_end; ++i) {
        const double depth = HitCurved(shape, curved, {double(x[i]), double(y[i]), 1.0}, local);
        if (depth > 0.0 && 1.0 / depth > w[i]) {
          w[i] = static_cast<float>(1.0 / depth);
          index[i] = curved.surface;
        }
      }
    });
  }
}

}  // namespace s3lam::synthetic
