// What the expensive steps of each stage cost, on synthetic input that is the same everywhere.
//
// The reference for features is OpenCV's own ORB on the same image: the unit in which whole runs
// can be compared between machines.

#include <benchmark/benchmark.h>

#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "s3lam/base/log.h"
#include "s3lam/refine/pipeline.h"
#include "s3lam/slam/features.h"
#include "s3lam/synthetic/render.h"
#include "s3lam/synthetic/scene.h"
#include "s3lam/synthetic/synthetic_map.h"

namespace s3lam {
namespace {

cv::Mat RenderGray(const Scene& scene) {
  cv::Mat gray;
  cv::cvtColor(Renderer(scene).Render(0).image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

void OpenCvOrb(benchmark::State& state) {
  const cv::Mat gray = RenderGray(MakeScene("desk", 1));
  cv::setNumThreads(1);
  const auto orb = cv::ORB::create(1000, 1.2F, 8);
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;
  for (auto _ : state) orb->detectAndCompute(gray, cv::noArray(), keypoints, descriptors);
}
BENCHMARK(OpenCvOrb)->Unit(benchmark::kMillisecond);

void Features(benchmark::State& state) {
  const Scene scene = MakeScene("desk", 1);
  const cv::Mat gray = RenderGray(scene);
  cv::setNumThreads(1);
  const Undistorter undistorter(scene.camera);
  for (auto _ : state) {
    benchmark::DoNotOptimize(ExtractFeatures(FeatureOptions(), undistorter, gray));
  }
}
BENCHMARK(Features)->Unit(benchmark::kMillisecond);

void Render(benchmark::State& state) {
  const Scene scene = MakeScene("desk", 1);
  const Renderer renderer(scene);
  for (auto _ : state) benchmark::DoNotOptimize(renderer.Render(0));
}
BENCHMARK(Render)->Unit(benchmark::kMillisecond);

/// Arguments: images, points, with planes (1) or without (0).
void Refine(benchmark::State& state) {
  InitLogging(true);
  SyntheticMapOptions map_options;
  map_options.num_images = static_cast<int>(state.range(0));
  map_options.num_points = static_cast<int>(state.range(1));
  map_options.point_sigma = 0.01;
  map_options.center_sigma = 0.002;
  map_options.rotation_sigma_deg = 0.2;
  const SyntheticMap map = MakeSyntheticMap("room", 1, map_options);
  refine::Input input;
  input.model = map.estimate;
  if (state.range(2) != 0) input.semantics = map.semantics;
  refine::Output output;
  for (auto _ : state) refine::Run(refine::Options(), input, output);
  state.counters["observations"] = static_cast<double>(map.estimate.NumObservations());
}
BENCHMARK(Refine)
    ->Args({40, 3000, 0})
    ->Args({40, 3000, 1})
    ->Args({160, 20000, 0})
    ->Args({160, 20000, 1})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace s3lam

BENCHMARK_MAIN();
