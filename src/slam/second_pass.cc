#include "s3lam/slam/second_pass.h"

#include <algorithm>

#include "s3lam/base/parallel.h"

namespace s3lam {
namespace {

/// The observation whose descriptor stands for the point.
size_t ReferenceOf(const Map& map, const MapPoint& point) {
  for (size_t i = 0; i < point.observations.size(); ++i) {
    const MapObservation& o = point.observations[i];
    if (map.features(o.keyframe).descriptor(o.keypoint) == point.descriptor) return i;
  }
  return 0;
}

/// Aligned places of one point's observations; empty entries did not align.
using AlignedPixels = std::vector<std::optional<Eigen::Vector2d>>;

AlignedPixels AlignPoint(const PatchRefiner& refiner, const Map& map, const MapPoint& point,
                         const std::vector<ImagePyramid>& pyramids) {
  const auto view_of = [&](const MapObservation& o) {
    const Keypoint& keypoint = map.keypoint(o);
    return PatchView{&pyramids[o.keyframe], map.keyframe(o.keyframe).cam_from_world,
                     keypoint.pixel.cast<double>(), keypoint.level};
  };
  const size_t reference = ReferenceOf(map, point);
  const PatchView reference_view = view_of(point.observations[reference]);
  AlignedPixels aligned(point.observations.size());
  for (size_t i = 0; i < aligned.size(); ++i) {
    if (i == reference) continue;
    aligned[i] = refiner.Align(reference_view, view_of(point.observations[i]), point.position,
                               point.view_direction);
  }
  const bool any =
      std::any_of(aligned.begin(), aligned.end(), [](auto& a) { return a.has_value(); });
  if (any) aligned[reference] = reference_view.pixel;
  return aligned;
}

}  // namespace

void SecondPassOptions::Visit(OptionVisitor& v) {
  v.Value("rounds", rounds, "of matching all keyframes again", 0, 20);
  v.Value("neighbours", neighbours, "keyframes that each is matched with", 1, 10000);
  v.Group("patches", patches, "alignment of observations to a fraction of a pixel");
}

void MatchAgain(const SecondPassOptions& options, const Mapper& mapper, Map& map) {
  for (int k = 0; k < map.num_keyframes(); ++k) {
    if (!map.keyframe(k).alive) continue;
    mapper.FuseWithNeighbours(map, k, options.neighbours);
    mapper.TriangulateNewPoints(map, k, options.neighbours);
  }
}

PatchRefinement RefineObservations(const SecondPassOptions& options,
                                   const FeatureOptions& feature_options,
                                   const Undistorter& undistorter,
                                   const std::function<cv::Mat(size_t)>& read_gray, int num_threads,
                                   Map& map) {
  std::vector<ImagePyramid> pyramids(static_cast<size_t>(map.num_keyframes()));
  ParallelFor(pyramids.size(), num_threads, [&](size_t k) {
    const Keyframe& keyframe = map.keyframe(static_cast<int>(k));
    if (!keyframe.alive) return;
    pyramids[k] = BuildPyramid(feature_options, read_gray(static_cast<size_t>(keyframe.frame)));
  });
  const PatchRefiner refiner(options.patches, feature_options, undistorter);
  std::vector<AlignedPixels> aligned(static_cast<size_t>(map.num_points()));
  ParallelFor(aligned.size(), num_threads, [&](size_t p) {
    const MapPoint& point = map.point(static_cast<int>(p));
    if (point.alive) aligned[p] = AlignPoint(refiner, map, point, pyramids);
  });
  PatchRefinement refinement;
  for (int p = 0; p < map.num_points(); ++p) {
    if (!map.point(p).alive) continue;
    const std::vector<MapObservation> observations = map.point(p).observations;
    for (size_t i = 0; i < observations.size(); ++i) {
      ++refinement.num_tried;
      const auto& pixel = aligned[p][i];
      const auto undistorted = pixel ? undistorter.Undistort(*pixel) : std::nullopt;
      if (!undistorted) {
        map.RemoveObservation(p, observations[i].keyframe);
        continue;
      }
      const double level_sigma = map.sigma(map.keypoint(observations[i]).level);
      map.MoveKeypoint(observations[i], *pixel, *undistorted,
                       options.patches.sigma_px * level_sigma);
      ++refinement.num_refined;
    }
  }
  return refinement;
}

}  // namespace s3lam
