#include "s3lam/synthetic/render.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numbers>
#include <vector>

#include "mip_texture.h"
#include "s3lam/base/error.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/rng.h"
#include "view.h"

namespace s3lam {
namespace {

using synthetic::Lanes;

constexpr int kSamples = 4;
// A rotated grid: every sample has its own quarter of the pixel in x and in y.
constexpr std::array<std::array<double, 2>, kSamples> kShifts{
    {{-0.125, -0.375}, {0.375, -0.125}, {-0.375, 0.125}, {0.125, 0.375}}};
constexpr int kBandRows = 16;     // Working set of a band stays in the cache.
constexpr int kRollingRows = 4;   // That a rolling shutter exposes at one time.
constexpr size_t kRunPixels = 8;  // Share one level of detail.
constexpr size_t kNoiseTableSize = 1U << 16;

// log2 to about 0.01, from the bits of the number; textures need no better.
float FastLog2(float value) {
  const auto bits = std::bit_cast<uint32_t>(value);
  const float mantissa = std::bit_cast<float>((bits & 0x007FFFFFU) | 0x3F800000U) - 1.0F;
  const float exponent = static_cast<float>(static_cast<int>(bits >> 23) - 127);
  return exponent + mantissa * (1.3465F - 0.3465F * mantissa);
}

// Level of detail for a pixel whose footprint in texels has these squared axes. Four samples a
// pixel cover a quarter of the longer axis each, so a slanted surface stays sharp.
float LevelOfDetail(float squared_major, float squared_minor) {
  const float quarter = squared_major * (1.0F / 16.0F);
  const float middle = 0.25F * std::sqrt(squared_major * squared_minor);
  return 0.5F * FastLog2(std::max(1e-6F, std::max(quarter, middle)));
}

// How a surface is shaded from one pose.
struct Shading {
  // Polygon: texture coordinates (texels) are u . r / w + u0 with w the inverse depth.
  Eigen::Vector3f u = Eigen::Vector3f::Zero(), v = Eigen::Vector3f::Zero();
  Eigen::Vector3f w = Eigen::Vector3f::Zero();
  float u0 = 0.0F, v0 = 0.0F;
  uint32_t light = 256;                               // Of 256, for polygons.
  const synthetic::PreparedCurved* curved = nullptr;  // Set for curved surfaces.
};

// One sub-exposure.
struct SubExposure {
  const synthetic::RayTable* rays = nullptr;
  synthetic::View view;
  std::vector<Shading> shadings;  // Per surface; refers to the view.
};

// Consecutive pixels of a row that show one surface.
struct Run {
  const float* x;
  const float* y;
  const float* inverse_depth;
  Lanes* sums;
  size_t count;
};

}  // namespace

struct Renderer::Impl {
  Impl(const Scene& the_scene, int num_threads, RenderContent content);
  void PaintTextures(int num_threads);

  [[nodiscard]] std::vector<Shading> MakeShadings(const synthetic::View& view) const;
  [[nodiscard]] float PolygonDetail(const Shading& shading, float x, float y,
                                    float inverse_depth) const;
  void ShadePolygon(const Shading& shading, int surface, const Run& run) const;
  [[nodiscard]] Lanes ShadeCurved(const Shading& shading, int surface, float x, float y,
                                  float inverse_depth) const;
  void ShadeRun(const SubExposure& exposure, int surface, const Run& run) const;
  /// Around `time_s`.
  void PrepareExposures(double time_s, std::array<SubExposure, kSamples>& exposures) const;
  void AddBand(const SubExposure& exposure, int begin, int end, std::vector<float>& inverse_depth,
               std::vector<int>& surface, Lanes* sums) const;
  [[nodiscard]] cv::Mat Develop(int frame, const std::vector<Lanes>& sums) const;
  void RenderTruth(int frame, RenderedFrame& rendered) const;
  /// Rows [begin, end) are exposed so much later than the middle of the image [s].
  [[nodiscard]] double DelayOf(int begin, int end) const {
    return (0.5 * (begin + end) / center_rays.height - 0.5) * scene.imaging.readout_time_s;
  }
  /// Of the image that has one time and one pose.
  [[nodiscard]] int RowsAtATime() const {
    return scene.imaging.readout_time_s > 0.0 ? kRollingRows : center_rays.height;
  }
  [[nodiscard]] uint32_t Light(const Eigen::Vector3d& normal_in_world) const;

  const Scene& scene;
  float pixel_x, pixel_y;  // Size of a pixel in ray coordinates.
  synthetic::RayTable center_rays;
  std::array<synthetic::RayTable, kSamples> sample_rays;
  std::vector<synthetic::TextureFrame> frames;
  std::vector<synthetic::MipTexture> textures;
  std::vector<float> vignette;  // Per pixel.
  std::vector<float> noise;     // Normal deviates.
};

Renderer::Impl::Impl(const Scene& the_scene, int num_threads, RenderContent content)
    : scene(the_scene),
      pixel_x(static_cast<float>(1.0 / the_scene.camera.FocalX())),
      pixel_y(static_cast<float>(1.0 / the_scene.camera.FocalY())) {
  center_rays = synthetic::MakeRayTable(scene.camera, num_threads);
  if (content == RenderContent::kLabelsOnly) return;
  PaintTextures(num_threads);
  for (size_t i = 0; i < kSamples; ++i) {
    sample_rays[i] = synthetic::ShiftRayTable(center_rays, kShifts[i][0], kShifts[i][1]);
  }
  // Light falls off with the square of the ray's slope, to the stated loss in the corner.
  double corner = 1e-12;
  for (size_t i = 0; i < center_rays.x.size(); ++i) {
    corner = std::max(corner, std::pow(center_rays.x[i], 2) + std::pow(center_rays.y[i], 2));
  }
  vignette.resize(center_rays.x.size());
  for (size_t i = 0; i < vignette.size(); ++i) {
    const double slope = std::pow(center_rays.x[i], 2) + std::pow(center_rays.y[i], 2);
    vignette[i] = static_cast<float>(1.0 - scene.imaging.vignetting * slope / corner);
  }
  Rng rng = Rng(scene.seed).Fork(77);
  noise.resize(kNoiseTableSize);
  for (float& value : noise) value = static_cast<float>(rng.Gaussian());
}

void Renderer::Impl::PaintTextures(int num_threads) {
  frames.resize(scene.surfaces.size());
  textures.resize(scene.surfaces.size());
  ParallelFor(scene.surfaces.size(), num_threads, [&](size_t i) {
    frames[i] = synthetic::TextureFrameOf(scene.surfaces[i]);
    textures[i] = synthetic::MipTexture(PaintTexture(scene.surfaces[i].texture, frames[i].size_m));
  });
}

uint32_t Renderer::Impl::Light(const Eigen::Vector3d& normal_in_world) const {
  static const Eigen::Vector3d kSun = Eigen::Vector3d(0.35, -0.5, 0.8).normalized();
  const double light = 0.78 + 0.22 * normal_in_world.dot(kSun);
  return static_cast<uint32_t>(std::lround(256.0 * std::clamp(light, 0.3, 1.0)));
}

std::vector<Shading> Renderer::Impl::MakeShadings(const synthetic::View& view) const {
  std::vector<Shading> shadings(scene.surfaces.size());
  const Rigid3& cam_from_world = view.cam_from_world;
  const Eigen::Vector3d center = cam_from_world.CenterInB();
  for (const synthetic::PreparedPolygon& polygon : view.polygons) {
    const auto index = static_cast<size_t>(polygon.surface);
    const Surface& surface = scene.surfaces[index];
    const auto axes = synthetic::PolygonAxes(surface);
    const double texels_u = textures[index].width() / frames[index].size_m.x();
    const double texels_v = textures[index].height() / frames[index].size_m.y();
    const Eigen::Vector3d u = texels_u * (cam_from_world.rotation * axes[0]);
    const Eigen::Vector3d v = -texels_v * (cam_from_world.rotation * axes[1]);
    const Eigen::Vector3d corner = cam_from_world * surface.corners[0];
    Shading& shading = shadings[index];
    shading.u = u.cast<float>();
    shading.v = v.cast<float>();
    shading.w = polygon.inverse_depth;
    shading.u0 = static_cast<float>(-u.dot(corner) - texels_u * frames[index].origin_m.x());
    // Row 0 is the upper edge.
    shading.v0 = static_cast<float>(
        -v.dot(corner) + texels_v * (frames[index].origin_m.y() + frames[index].size_m.y()));
    Eigen::Vector3d normal = axes[0].cross(axes[1]);
    if (normal.dot(center - surface.corners[0]) < 0.0) normal = -normal;
    shading.light = Light(normal);
  }
  for (const synthetic::PreparedCurved& curved : view.curved) {
    shadings[static_cast<size_t>(curved.surface)].curved = &curved;
  }
  return shadings;
}

float Renderer::Impl::PolygonDetail(const Shading& s, float x, float y, float inverse_depth) const {
  const float depth = 1.0F / inverse_depth;
  const float u = (s.u[0] * x + s.u[1] * y + s.u[2]) * depth;
  const float v = (s.v[0] * x + s.v[1] * y + s.v[2]) * depth;
  // Derivatives by the pixel: d(U/w) = (dU - (U/w) dw) / w.
  const float ux = (s.u[0] - u * s.w[0]) * depth * pixel_x;
  const float uy = (s.u[1] - u * s.w[1]) * depth * pixel_y;
  const float vx = (s.v[0] - v * s.w[0]) * depth * pixel_x;
  const float vy = (s.v[1] - v * s.w[1]) * depth * pixel_y;
  // Squared axes of the footprint ellipse: eigenvalues of J J^T.
  const float trace = ux * ux + uy * uy + vx * vx + vy * vy;
  const float determinant = ux * vy - uy * vx;
  const float squared = determinant * determinant;
  const float root = std::sqrt(std::max(0.0F, trace * trace - 4.0F * squared));
  const float major = 0.5F * (trace + root);
  return LevelOfDetail(major, squared / std::max(1e-12F, major));
}

// Neighbouring pixels of one surface share the level of detail.
void Renderer::Impl::ShadePolygon(const Shading& s, int surface, const Run& run) const {
  const size_t middle = run.count / 2;
  const float lod = PolygonDetail(s, run.x[middle], run.y[middle], run.inverse_depth[middle]);
  const auto sampler = textures[static_cast<size_t>(surface)].At(lod);
  const float u_x = s.u[0], u_y = s.u[1], u_1 = s.u[2], v_x = s.v[0], v_y = s.v[1], v_1 = s.v[2];
  for (size_t i = 0; i < run.count; ++i) {
    const float depth = 1.0F / run.inverse_depth[i];
    const float u = (u_x * run.x[i] + u_y * run.y[i] + u_1) * depth + s.u0;
    const float v = (v_x * run.x[i] + v_y * run.y[i] + v_1) * depth + s.v0;
    run.sums[i] += synthetic::Scale(sampler(u, v), s.light);
  }
}

Lanes Renderer::Impl::ShadeCurved(const Shading& s, int surface, float x, float y,
                                  float inverse_depth) const {
  const auto index = static_cast<size_t>(surface);
  const Surface& shape = scene.surfaces[index];
  const synthetic::PreparedCurved& curved = *s.curved;
  const double depth = 1.0 / inverse_depth;
  const Eigen::Vector3d direction = curved.matrix * Eigen::Vector3d(x, y, 1.0);
  Eigen::Vector3d local = curved.origin + depth * direction;
  const double turn = std::max(shape.angle_min, -std::numbers::pi);
  const double end = std::min(shape.angle_max, std::numbers::pi);
  const float angle = std::atan2(static_cast<float>(local.y()), static_cast<float>(local.x()));
  const double u = (angle - turn) / (end - turn);
  double v = 0.0;
  if (shape.shape == SurfaceShape::kCylinder) {
    v = (local.z() - shape.z_min) / (shape.z_max - shape.z_min);
    local.z() = 0.0;
  } else {
    const double low = std::asin(shape.z_min);
    v = (std::asin(std::clamp(local.z(), -1.0, 1.0)) - low) / (std::asin(shape.z_max) - low);
  }
  Eigen::Vector3d normal =
      (shape.world_from_local.rotation * local.cwiseQuotient(shape.radii)).normalized();
  const Eigen::Vector3d ray_in_world =
      shape.world_from_local.rotation * direction.cwiseProduct(shape.radii);
  double slant = normal.dot(ray_in_world) / ray_in_world.norm();
  if (slant > 0.0) normal = -normal;
  slant = std::max(0.1, std::abs(slant));
  const synthetic::MipTexture& texture = textures[index];
  const double texels_per_m = texture.width() / frames[index].size_m.x();
  const auto minor = static_cast<float>(depth * pixel_x * texels_per_m);
  const auto major = static_cast<float>(minor / slant);
  const auto sampler = texture.At(LevelOfDetail(major * major, minor * minor));
  const Lanes color = sampler(static_cast<float>(u * texture.width()),
                              static_cast<float>((1.0 - v) * texture.height()));
  return synthetic::Scale(color, Light(normal));
}

void Renderer::Impl::ShadeRun(const SubExposure& exposure, int surface, const Run& run) const {
  const Shading& shading = exposure.shadings[static_cast<size_t>(surface)];
  if (shading.curved == nullptr) {
    ShadePolygon(shading, surface, run);
    return;
  }
  for (size_t i = 0; i < run.count; ++i) {
    run.sums[i] += ShadeCurved(shading, surface, run.x[i], run.y[i], run.inverse_depth[i]);
  }
}

void Renderer::Impl::PrepareExposures(double time_s,
                                      std::array<SubExposure, kSamples>& exposures) const {
  for (size_t k = 0; k < kSamples; ++k) {
    SubExposure& exposure = exposures[k];
    const double share = (static_cast<double>(k) + 0.5) / kSamples;
    const Rigid3 world_from_camera =
        scene.path.WorldFromCamera(time_s + (share - 0.5) * scene.imaging.exposure_time_s);
    exposure.rays = &sample_rays[k];
    exposure.view = synthetic::PrepareView(scene, sample_rays[k], world_from_camera.Inverse());
    exposure.shadings = MakeShadings(exposure.view);
  }
}

// Adds one sub-exposure to rows [begin, end); `sums` starts at row 0. The two buffers are scratch.
void Renderer::Impl::AddBand(const SubExposure& exposure, int begin, int end,
                             std::vector<float>& inverse_depth, std::vector<int>& surface,
                             Lanes* sums) const {
  const Rgb& sky = scene.background;
  const Lanes background = synthetic::LanesOfColor(sky[2], sky[1], sky[0]);
  const synthetic::RayTable& rays = *exposure.rays;
  const auto row_size = static_cast<size_t>(rays.width);
  synthetic::FindVisible(scene, rays, exposure.view, begin, end, inverse_depth.data(),
                         surface.data());
  const auto offset = static_cast<size_t>(begin) * row_size;
  const size_t size = static_cast<size_t>(end - begin) * row_size;
  for (size_t i = 0; i < size;) {
    size_t count = 1;
    const size_t row_end = (i / row_size + 1) * row_size;
    while (count < kRunPixels && i + count < row_end && surface[i + count] == surface[i]) ++count;
    const size_t at = offset + i;
    if (surface[i] < 0) {
      for (size_t k = 0; k < count; ++k) sums[at + k] += background;
    } else {
      ShadeRun(exposure, surface[i],
               {&rays.x[at], &rays.y[at], &inverse_depth[i], sums + at, count});
    }
    i += count;
  }
}

cv::Mat Renderer::Impl::Develop(int frame, const std::vector<Lanes>& sums) const {
  const Imaging& imaging = scene.imaging;
  Rng rng = Rng(scene.seed).Fork(78).Fork(static_cast<uint64_t>(frame));
  const double time_s = scene.TimeOf(frame);
  const double phase = 2.0 * std::numbers::pi * Rng(scene.seed).Fork(79).Uniform();
  const double exposure =
      1.0 + imaging.exposure_swing *
                (0.7 * std::sin(0.9 * time_s + phase) + 0.3 * std::sin(2.3 * time_s + 2.0 * phase));
  const auto gain = static_cast<float>(exposure / kSamples);
  // Read-out noise plus shot noise, which grows with the root of the light.
  std::array<float, 256> sigma;
  for (size_t i = 0; i < sigma.size(); ++i) {
    sigma[i] = static_cast<float>(imaging.noise_sigma *
                                  std::sqrt(0.4 + 0.6 * static_cast<double>(i) / 128.0));
  }
  const int channels = imaging.color ? 3 : 1;
  cv::Mat image(center_rays.height, center_rays.width, imaging.color ? CV_8UC3 : CV_8UC1);
  for (int y = 0; y < image.rows; ++y) {
    auto* out = image.ptr<uint8_t>(y);
    size_t at = rng.Below(kNoiseTableSize);
    for (int x = 0; x < image.cols; ++x) {
      const auto i = static_cast<size_t>(y * image.cols + x);
      const float light = gain * vignette[i];
      const float bgr[3] = {light * static_cast<float>(synthetic::BlueOf(sums[i])),
                            light * static_cast<float>(synthetic::GreenOf(sums[i])),
                            light * static_cast<float>(synthetic::RedOf(sums[i]))};
      const float gray = 0.114F * bgr[0] + 0.587F * bgr[1] + 0.299F * bgr[2];
      for (int k = 0; k < channels; ++k) {
        const float value = channels == 1 ? gray : bgr[k];
        const float spread = sigma[static_cast<size_t>(std::min(255.0F, value))];
        at = (at + 1) & (kNoiseTableSize - 1);
        *out++ = static_cast<uint8_t>(std::clamp(value + spread * noise[at] + 0.5F, 0.0F, 255.0F));
      }
    }
  }
  return image;
}

void Renderer::Impl::RenderTruth(int frame, RenderedFrame& rendered) const {
  const int height = center_rays.height;
  rendered.depth.create(height, center_rays.width, CV_32F);
  rendered.labels.create(height, center_rays.width, CV_32S);
  auto* depth = rendered.depth.ptr<float>();
  auto* label = rendered.labels.ptr<int>();
  for (int begin = 0; begin < height; begin += RowsAtATime()) {
    const int end = std::min(height, begin + RowsAtATime());
    const synthetic::View view = synthetic::PrepareView(
        scene, center_rays,
        scene.path.WorldFromCamera(scene.TimeOf(frame) + DelayOf(begin, end)).Inverse());
    const size_t offset = static_cast<size_t>(begin) * static_cast<size_t>(center_rays.width);
    synthetic::FindVisible(scene, center_rays, view, begin, end, depth + offset, label + offset);
  }
  for (size_t i = 0; i < rendered.depth.total(); ++i) {
    const int surface = label[i];
    depth[i] = surface < 0 ? 0.0F : 1.0F / depth[i];
    label[i] =
        surface < 0
            ? 0
            : scene
                  .objects[static_cast<size_t>(scene.surfaces[static_cast<size_t>(surface)].object)]
                  .id;
  }
}

Renderer::Renderer(const Scene& scene, int num_threads, RenderContent content)
    : impl_(std::make_unique<Impl>(scene, num_threads, content)) {}
Renderer::~Renderer() = default;

RenderedFrame Renderer::RenderLabels(int frame) const {
  S3LAM_CHECK(frame >= 0);
  RenderedFrame rendered;
  rendered.world_from_camera = impl_->scene.WorldFromCamera(frame);
  impl_->RenderTruth(frame, rendered);
  return rendered;
}

RenderedFrame Renderer::Render(int frame) const {
  S3LAM_CHECK(!impl_->textures.empty());
  RenderedFrame rendered = RenderLabels(frame);
  std::array<SubExposure, kSamples> exposures;
  const int width = impl_->center_rays.width;
  const int height = impl_->center_rays.height;
  std::vector<Lanes> sums(impl_->center_rays.x.size(), 0);
  std::vector<float> inverse_depth(static_cast<size_t>(width * kBandRows));
  std::vector<int> surface(inverse_depth.size());
  const int band_rows = std::min(kBandRows, impl_->RowsAtATime());
  for (int begin = 0; begin < height; begin += band_rows) {
    const int end = std::min(height, begin + band_rows);
    if (begin % impl_->RowsAtATime() == 0) {
      const int same_time_end = std::min(height, begin + impl_->RowsAtATime());
      impl_->PrepareExposures(impl_->scene.TimeOf(frame) + impl_->DelayOf(begin, same_time_end),
                              exposures);
    }
    for (const SubExposure& exposure : exposures) {
      impl_->AddBand(exposure, begin, end, inverse_depth, surface, sums.data());
    }
  }
  rendered.image = impl_->Develop(frame, sums);
  return rendered;
}

}  // namespace s3lam
