// What the kernels inside the stages cost, one at a time and on one thread, on synthetic input that
// is the same everywhere.

#include <benchmark/benchmark.h>
#include <fmt/format.h>
#include <stdlib.h>

#include <filesystem>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "s3lam/base/rng.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/panoptic_masks.h"
#include "s3lam/io/semantic_map_io.h"
#include "s3lam/optim/pose_refinement.h"
#include "s3lam/refine/cost_functions.h"
#include "s3lam/robust/plane_fit.h"
#include "s3lam/semantics/label_fusion.h"
#include "s3lam/slam/features.h"
#include "s3lam/slam/matcher.h"
#include "s3lam/synthetic/panoptic.h"
#include "s3lam/synthetic/render.h"
#include "s3lam/synthetic/scene.h"
#include "s3lam/synthetic/synthetic_map.h"

namespace s3lam {
namespace {

namespace fs = std::filesystem;

/// A folder that goes with the benchmark.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::string name = (fs::temp_directory_path() / "s3lam_benchmark_XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("cannot create " + name);
    path_ = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

// ---- features and matching ----

cv::Mat RenderGray(const Scene& scene, int frame) {
  cv::Mat gray;
  cv::cvtColor(Renderer(scene).Render(frame).image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

/// Argument: keypoints asked for.
void ExtractKeypoints(benchmark::State& state) {
  const Scene scene = MakeScene("desk", 1);
  const cv::Mat gray = RenderGray(scene, 0);
  const Undistorter undistorter(scene.camera);
  FeatureOptions options;
  options.num_features = static_cast<int>(state.range(0));
  cv::setNumThreads(1);
  for (auto _ : state) benchmark::DoNotOptimize(ExtractFeatures(options, undistorter, gray));
}
BENCHMARK(ExtractKeypoints)->Arg(500)->Arg(1000)->Arg(2000)->Unit(benchmark::kMillisecond);

/// Every descriptor of a frame against every one of another. Argument: keypoints asked for.
void MatchAllDescriptors(benchmark::State& state) {
  const Scene scene = MakeScene("desk", 1);
  const Undistorter undistorter(scene.camera);
  FeatureOptions options;
  options.num_features = static_cast<int>(state.range(0));
  const FrameFeatures a = ExtractFeatures(options, undistorter, RenderGray(scene, 0));
  const FrameFeatures b = ExtractFeatures(options, undistorter, RenderGray(scene, 5));
  std::vector<int> all_a(static_cast<size_t>(a.size()));
  std::vector<int> all_b(static_cast<size_t>(b.size()));
  std::iota(all_a.begin(), all_a.end(), 0);
  std::iota(all_b.begin(), all_b.end(), 0);
  for (auto _ : state) {
    benchmark::DoNotOptimize(MatchDescriptors(a, b, all_a, all_b, 50, 0.8));
  }
  state.SetItemsProcessed(state.iterations() * a.size() * b.size());
}
BENCHMARK(MatchAllDescriptors)->Arg(500)->Arg(1000)->Arg(2000)->Unit(benchmark::kMillisecond);

// ---- optimisation ----

/// Motion-only bundle adjustment. Argument: points seen.
void RefineOnePose(benchmark::State& state) {
  Rng rng(1);
  const PinholeIntrinsics camera{500.0, 500.0, 320.0, 240.0};
  std::vector<PoseObservation> observations;
  for (int i = 0; i < state.range(0); ++i) {
    PoseObservation observation;
    const double x = rng.Uniform(-2.0, 2.0);
    const double y = rng.Uniform(-1.5, 1.5);
    observation.point_in_world = {x, y, rng.Uniform(3.0, 6.0)};
    const double u = rng.Gaussian(0.0, 1.0);
    observation.xy =
        camera.Project(observation.point_in_world) + Eigen::Vector2d(u, rng.Gaussian(0.0, 1.0));
    observations.push_back(observation);
  }
  const Rigid3 start{QuaternionFromRotationVector({0.01, -0.02, 0.01}), {0.05, 0.02, -0.03}};
  for (auto _ : state) {
    Rigid3 pose = start;
    benchmark::DoNotOptimize(RefinePose(camera, observations, pose));
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(RefineOnePose)->Arg(100)->Arg(300)->Arg(1000)->Unit(benchmark::kMicrosecond);

/// Some parameters of a 640 x 480 camera.
std::vector<double> SomeParams(CameraModel model) {
  const int size = CameraModelNumParams(model);
  std::vector<double> params = {500.0, 320.0, 240.0};
  if (!CameraModelHasSingleFocal(model)) params = {500.0, 500.0, 320.0, 240.0};
  if (model == CameraModel::kFov) params.push_back(0.8);
  while (static_cast<int>(params.size()) < size) params.push_back(0.01);
  return params;
}

/// Residual and Jacobians by pose and point. Argument: COLMAP's id of the camera model.
void Reprojection(benchmark::State& state) {
  const auto model = CameraModelFromId(static_cast<int>(state.range(0))).value();
  const std::vector<double> params = SomeParams(model);
  const ReprojectionCost cost(model, {330.0, 250.0}, 1.0);
  const double pose[7] = {0.0, 0.0, 0.0, 1.0, 0.1, 0.2, 0.3};
  const double point[3] = {0.3, -0.2, 4.0};
  const double* parameters[3] = {pose, point, params.data()};
  double residuals[2];
  double pose_jacobian[14];
  double point_jacobian[6];
  double* jacobians[3] = {pose_jacobian, point_jacobian, nullptr};
  for (auto _ : state) {
    benchmark::DoNotOptimize(cost.Evaluate(parameters, residuals, jacobians));
    benchmark::DoNotOptimize(residuals);
    benchmark::ClobberMemory();
  }
  state.SetLabel(std::string(CameraModelName(model)));
}
BENCHMARK(Reprojection)->DenseRange(0, kNumCameraModels - 1)->Unit(benchmark::kNanosecond);

/// Residual and Jacobians by point and plane.
void PointPlane(benchmark::State& state) {
  const PointPlaneCost cost({0.0, 0.0, 1.0}, 0.01);
  const double point[3] = {0.3, -0.2, 4.0};
  const double plane[4] = {0.0, 0.0, 1.0, 0.1};
  const double* parameters[2] = {point, plane};
  double residual[1];
  double point_jacobian[3];
  double plane_jacobian[4];
  double* jacobians[2] = {point_jacobian, plane_jacobian};
  for (auto _ : state) {
    benchmark::DoNotOptimize(cost.Evaluate(parameters, residual, jacobians));
    benchmark::ClobberMemory();
  }
}
BENCHMARK(PointPlane)->Unit(benchmark::kNanosecond);

// ---- planes and labels ----

/// Arguments: points, of which so many per cent lie on the plane.
void FitPlaneByRansac(benchmark::State& state) {
  Rng rng(2);
  std::vector<UncertainPoint> points(static_cast<size_t>(state.range(0)));
  for (UncertainPoint& point : points) {
    const bool on_plane = rng.Uniform() * 100.0 < static_cast<double>(state.range(1));
    const double x = rng.Uniform(-1.0, 1.0);
    const double y = rng.Uniform(-1.0, 1.0);
    point.xyz = {x, y, on_plane ? rng.Gaussian(0.0, 0.01) : rng.Uniform(-1.0, 1.0)};
    point.covariance = 1e-4 * Eigen::Matrix3d::Identity();
  }
  for (auto _ : state) {
    Rng draws(3);
    benchmark::DoNotOptimize(FitPlaneRobustly(points, PlaneFitOptions(), NormalBand(), draws));
  }
}
BENCHMARK(FitPlaneByRansac)
    ->Args({100, 80})
    ->Args({1000, 80})
    ->Args({1000, 40})
    ->Args({10000, 80})
    ->Unit(benchmark::kMicrosecond);

/// Arguments: points, observations of each. 133 classes, as COCO has them.
void FusePointLabels(benchmark::State& state) {
  constexpr int kClasses = 133;
  Rng rng(4);
  MaskObservations masks;
  for (int i = 0; i < 1000; ++i) {
    SegmentNode segment;
    segment.label.class_index = static_cast<int>(rng.Below(kClasses));
    segment.label.score = rng.Uniform(0.5, 1.0);
    masks.segments.push_back(segment);
  }
  masks.first_observation.push_back(0);
  for (int64_t i = 0; i < state.range(0); ++i) {
    masks.points.emplace_back(static_cast<uint64_t>(i));
    for (int64_t k = 0; k < state.range(1); ++k) {
      masks.observations.push_back(
          {static_cast<uint32_t>(k), static_cast<int32_t>(rng.Below(1000)), false, false});
    }
    masks.first_observation.push_back(static_cast<uint32_t>(masks.observations.size()));
  }
  for (auto _ : state) {
    benchmark::DoNotOptimize(FuseLabels(masks, kClasses, FusionOptions()));
  }
  state.SetItemsProcessed(state.iterations() * state.range(0) * state.range(1));
}
BENCHMARK(FusePointLabels)->Args({1000, 10})->Args({10000, 10})->Unit(benchmark::kMillisecond);

// ---- files ----

/// A KITTI-STEP mask of the street, 8-bit RGB PNG.
void DecodeMask(benchmark::State& state) {
  const Scene scene = MakeScene("street", 1);
  const Renderer renderer(scene, 1, RenderContent::kLabelsOnly);
  const PanopticFrame frame = MakePanoptic(scene, 0, renderer.RenderLabels(0).labels).frame;
  cv::Mat image(static_cast<int>(frame.segment_ids.rows()),
                static_cast<int>(frame.segment_ids.cols()), CV_8UC3, cv::Scalar::all(255));
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const uint32_t id = frame.segment_ids(y, x);
      if (id == kNoSegment) continue;
      const auto byte = [&](int shift) { return static_cast<uint8_t>(id >> shift); };
      image.at<cv::Vec3b>(y, x) = {byte(16), byte(8), byte(0)};
    }
  }
  const ScratchFolder folder;
  cv::imwrite((folder.path() / "000000.png").string(), image);
  const PanopticMasks masks(folder.path(), MaskFormat::kKittiStep, {}, scene.class_table);
  for (auto _ : state) benchmark::DoNotOptimize(masks.Read(0));
  state.SetLabel(fmt::format("{} x {}", image.cols, image.rows));
}
BENCHMARK(DecodeMask)->Unit(benchmark::kMillisecond);

Reconstruction SomeModel(benchmark::State& state) {
  SyntheticMapOptions options;
  options.num_images = static_cast<int>(state.range(0));
  options.num_points = static_cast<int>(state.range(1));
  Reconstruction model = MakeSyntheticMap("room", 1, options).estimate;
  state.counters["observations"] = static_cast<double>(model.NumObservations());
  return model;
}

/// Arguments: images, points; text (1) or binary (0).
void WriteModel(benchmark::State& state) {
  const Reconstruction model = SomeModel(state);
  const ScratchFolder folder;
  for (auto _ : state) {
    if (state.range(2) != 0) {
      WriteColmapModelText(model, folder.path());
    } else {
      WriteColmapModel(model, folder.path());
    }
  }
}
BENCHMARK(WriteModel)->Args({80, 10000, 0})->Args({80, 10000, 1})->Unit(benchmark::kMillisecond);

void ReadModel(benchmark::State& state) {
  const Reconstruction model = SomeModel(state);
  const ScratchFolder folder;
  if (state.range(2) != 0) {
    WriteColmapModelText(model, folder.path());
  } else {
    WriteColmapModel(model, folder.path());
  }
  for (auto _ : state) benchmark::DoNotOptimize(ReadColmapModel(folder.path()));
}
BENCHMARK(ReadModel)->Args({80, 10000, 0})->Args({80, 10000, 1})->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace s3lam

BENCHMARK_MAIN();
