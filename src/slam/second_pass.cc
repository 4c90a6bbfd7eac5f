#include "s3lam/slam/second_pass.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "s3lam/base/error.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/statistics.h"

namespace s3lam {
namespace {

constexpr size_t kViewsOfNormal = 3;
constexpr double kMinAlignedShare = 0.5;  // Below it a frame keeps what does not align.

/// Lengths of the residuals of all observations [px] by level, as if no point were fitted to them.
std::vector<std::vector<double>> ResidualLengths(const Undistorter& undistorter, const Map& map) {
  std::vector<std::vector<double>> lengths(static_cast<size_t>(map.num_levels()));
  for (int p = 0; p < map.num_points(); ++p) {
    const MapPoint& point = map.point(p);
    if (!point.alive || point.observations.size() < 2) continue;
    const double correction = ResidualCorrection(point.observations.size());
    for (const MapObservation& o : point.observations) {
      const Keypoint& keypoint = map.keypoint(o);
      const double squared =
          SquaredError(undistorter.intrinsics(), map.keyframe(o.keyframe).cam_from_world,
                       point.position, keypoint.undistorted.cast<double>(), 1.0);
      lengths[keypoint.level].push_back(correction * std::sqrt(squared));
    }
  }
  return lengths;
}

/// The detected observation whose descriptor stands for the point: keypoints that were found by
/// their patch have the point's descriptor, too.
size_t ReferenceOf(const Map& map, const MapPoint& point) {
  for (size_t i = 0; i < point.observations.size(); ++i) {
    const MapObservation& o = point.observations[i];
    const FrameFeatures& features = map.features(o.keyframe);
    if (o.keypoint >= features.num_detected()) continue;
    if (features.descriptor(o.keypoint) == point.descriptor) return i;
  }
  return 0;
}

size_t NumBytes(const ImagePyramid& pyramid) {
  size_t bytes = 0;
  for (const cv::Mat& level : pyramid.levels) bytes += level.total();
  return bytes;
}

/// The same pyramid, with its pixels in the room given.
ImagePyramid CopyTo(std::byte* room, const ImagePyramid& pyramid) {
  ImagePyramid copy = pyramid;
  for (cv::Mat& level : copy.levels) {
    const cv::Mat there(level.size(), CV_8UC1, room);
    level.copyTo(there);
    level = there;
    room += level.total();
  }
  return copy;
}

/// Is the keypoint among those that the grid knows (the ones just added are not looked at)?
bool IsPresent(const FrameFeatures& features, const Keypoint& keypoint) {
  bool present = false;
  features.VisitNear(keypoint.undistorted.cast<double>(), keypoint.sigma, keypoint.level,
                     keypoint.level, [&](int) { present = true; });
  return present;
}

}  // namespace

void SecondPassOptions::Visit(OptionVisitor& v) {
  v.Value("keyframe_features", keyframe_features,
          "keypoints per keyframe where more than features.num_features: a denser, slower map", 0,
          20000);
  v.Value("rounds", rounds, "of matching all keyframes again", 0, 20);
  v.Value("neighbours", neighbours, "keyframes that each is matched with", 1, 10000);
  v.Value("extend_tracks", extend_tracks,
          "look for points, by their patches, where no keypoint was detected");
  v.Value("align_again", align_again,
          "align observations once more when the map is adjusted and tracks are extended: normals "
          "are known better then");
  v.Value("align_frames", align_frames,
          "align what all frames see with the patches of the keyframes");
  v.Group("patches", patches, "alignment of observations to a fraction of a pixel");
  v.Group("noise", noise, "of aligned observations");
}

void AlignmentNoiseOptions::Visit(OptionVisitor& v) {
  v.Value("measured", measured,
          "adjust once more with the standard deviation that the residuals on each level show, in "
          "the place of patches.sigma_px");
  v.Value("quantile", quantile, "of the residuals, which says how large it is", 0.1, 0.99);
  v.Value("min_residuals", min_residuals, "a level with fewer keeps patches.sigma_px", 1, 1000000);
  v.Value("min_sigma_px", min_sigma_px, "it is at least that, on its level [px]", 1e-3, 10.0);
  v.Value("max_reprojection_sigma", max_reprojection_sigma,
          "observations that are off by more are removed [sigma]", 1.0, 1e6);
}

int AddKeyframeFeatures(const SecondPassOptions& options, FeatureOptions feature_options,
                        const Undistorter& undistorter, const FrameImages& images, int num_threads,
                        Map& map) {
  if (options.keyframe_features <= feature_options.num_features) return 0;
  feature_options.num_features = options.keyframe_features;
  std::vector<FrameFeatures> denser(static_cast<size_t>(map.num_keyframes()));
  const std::vector<int> in_time = map.KeyframesInTime();  // Videos are decoded forwards.
  ParallelFor(in_time.size(), num_threads, [&](size_t i) {
    const int k = in_time[i];
    const auto frame = static_cast<size_t>(map.keyframe(k).frame);
    denser[k] = ExtractFeatures(feature_options, undistorter, images.read_gray(frame),
                                images.read_mask ? images.read_mask(frame) : cv::Mat());
  });
  int count = 0;
  for (int k = 0; k < map.num_keyframes(); ++k) {
    const int num_present = map.keyframe(k).alive ? map.features(k).size() : 0;
    for (int i = 0; i < denser[k].size(); ++i) {
      const Keypoint& keypoint = denser[k].keypoint(i);
      if (IsPresent(map.features(k), keypoint)) continue;
      map.AddKeypoint(k, keypoint, denser[k].descriptor(i));
    }
    denser[k] = {};
    if (!map.keyframe(k).alive) continue;
    map.BuildGrid(k, undistorter);
    count += map.features(k).size() - num_present;
  }
  return count;
}

void MatchAgain(const SecondPassOptions& options, const Mapper& mapper, Map& map) {
  for (int k = 0; k < map.num_keyframes(); ++k) {
    if (!map.keyframe(k).alive) continue;
    mapper.FuseWithNeighbours(map, k, options.neighbours);
    mapper.TriangulateNewPoints(map, k, options.neighbours);
  }
}

void MeasureAlignedSigmas(const AlignmentNoiseOptions& options, const Undistorter& undistorter,
                          Map& map) {
  const auto lengths = ResidualLengths(undistorter, map);
  std::vector<double> sigmas;
  for (int level = 0; level < map.num_levels(); ++level) {
    if (static_cast<int>(lengths[level].size()) < options.min_residuals) {
      sigmas.push_back(map.aligned_sigma(level));
      continue;
    }
    const double sigma =
        UpperQuantile(lengths[level], options.quantile) / RayleighQuantile(options.quantile);
    sigmas.push_back(std::max(options.min_sigma_px * map.sigma(level), sigma));
  }
  map.SetAlignedSigmas(std::move(sigmas));
  for (int p = 0; p < map.num_points(); ++p) {
    if (!map.point(p).alive) continue;
    for (const MapObservation& o : map.point(p).observations) {
      map.SetSigma(o, map.aligned_sigma(map.keypoint(o).level));
    }
  }
}

PatchPass::PatchPass(const SecondPassOptions& options, const FeatureOptions& feature_options,
                     const Undistorter& undistorter, const FrameImages& images, int num_threads,
                     const Map& map)
    : options_(options),
      undistorter_(undistorter),
      num_threads_(num_threads),
      refiner_(options.patches, feature_options, undistorter),
      pyramids_(static_cast<size_t>(map.num_keyframes())),
      masks_(pyramids_.size()) {
  const std::vector<int> alive = map.KeyframesInTime();  // Videos are decoded forwards.
  if (alive.empty()) return;
  const auto build = [&](int keyframe) {
    const auto frame = static_cast<size_t>(map.keyframe(keyframe).frame);
    return BuildPyramid(feature_options, images.read_gray(frame));
  };
  const size_t bytes = NumBytes(build(alive.front()));  // All images have the camera's size.
  pixels_ = ScratchMemory(alive.size() * bytes,
                          fmt::format("images of {} keyframes, to align patches "
                                      "(second_pass.patches.enabled=false does without)",
                                      alive.size()));
  ParallelFor(alive.size(), num_threads, [&](size_t i) {
    const ImagePyramid pyramid = build(alive[i]);
    S3LAM_CHECK(NumBytes(pyramid) == bytes);
    pyramids_[alive[i]] = CopyTo(pixels_.data() + i * bytes, pyramid);
    if (!images.read_mask) return;
    masks_[alive[i]] = images.read_mask(static_cast<size_t>(map.keyframe(alive[i]).frame));
  });
}

PatchView PatchPass::ViewOf(const Map& map, const MapObservation& o) const {
  const Keypoint& keypoint = map.keypoint(o);
  return {&pyramids_[o.keyframe], map.keyframe(o.keyframe).cam_from_world,
          keypoint.pixel.cast<double>(), keypoint.level};
}

Eigen::Vector3d PatchPass::NormalOf(const Map& map, const MapPoint& point, size_t reference) const {
  const auto ray_of = [&](size_t i) -> Eigen::Vector3d {
    const Rigid3& pose = map.keyframe(point.observations[i].keyframe).cam_from_world;
    return (point.position - pose.CenterInB()).normalized();
  };
  const Eigen::Vector3d reference_ray = ray_of(reference);
  std::vector<std::pair<double, size_t>> by_cosine;
  for (size_t i = 0; i < point.observations.size(); ++i) {
    if (i != reference) by_cosine.emplace_back(ray_of(i).dot(reference_ray), i);
  }
  std::sort(by_cosine.begin(), by_cosine.end());
  by_cosine.resize(std::min(by_cosine.size(), kViewsOfNormal));
  std::vector<PatchView> targets;
  for (const auto& [cosine, i] : by_cosine) targets.push_back(ViewOf(map, point.observations[i]));
  return refiner_.EstimateNormal(ViewOf(map, point.observations[reference]), targets,
                                 point.position, point.view_direction);
}

PatchPass::AlignedPoint PatchPass::AlignPoint(const Map& map, const MapPoint& point) const {
  const size_t reference = ReferenceOf(map, point);
  const PatchView reference_view = ViewOf(map, point.observations[reference]);
  AlignedPoint aligned{NormalOf(map, point, reference), {}};
  aligned.pixels.resize(point.observations.size());
  bool any = false;
  for (size_t i = 0; i < aligned.pixels.size(); ++i) {
    if (i == reference) continue;
    aligned.pixels[i] = refiner_.Align(reference_view, ViewOf(map, point.observations[i]),
                                       point.position, aligned.normal);
    any = any || aligned.pixels[i].has_value();
  }
  if (any) aligned.pixels[reference] = reference_view.pixel;
  return aligned;
}

PatchRefinement PatchPass::RefineObservations(Map& map) const {
  std::vector<double> sigmas;
  for (int level = 0; level < map.num_levels(); ++level) {
    sigmas.push_back(options_.patches.sigma_px * map.sigma(level));
  }
  map.SetAlignedSigmas(std::move(sigmas));
  std::vector<AlignedPoint> aligned(static_cast<size_t>(map.num_points()));
  ParallelFor(aligned.size(), num_threads_, [&](size_t p) {
    const MapPoint& point = map.point(static_cast<int>(p));
    if (point.alive) aligned[p] = AlignPoint(map, point);
  });
  PatchRefinement refinement;
  for (int p = 0; p < map.num_points(); ++p) {
    if (!map.point(p).alive) continue;
    map.SetNormal(p, aligned[p].normal);
    const std::vector<MapObservation> observations = map.point(p).observations;
    for (size_t i = 0; i < observations.size(); ++i) {
      ++refinement.num_tried;
      const auto& pixel = aligned[p].pixels[i];
      const bool usable = pixel && !IsMasked(masks_[observations[i].keyframe], *pixel);
      const auto undistorted = usable ? undistorter_.Undistort(*pixel) : std::nullopt;
      if (!undistorted) {
        map.RemoveObservation(p, observations[i].keyframe);
        continue;
      }
      map.MoveKeypoint(map.keyframe(observations[i].keyframe).frame, observations[i].keypoint,
                       *pixel, *undistorted,
                       map.aligned_sigma(map.keypoint(observations[i]).level));
      ++refinement.num_refined;
    }
  }
  return refinement;
}

std::vector<PatchPass::NewObservation> PatchPass::FindInNeighbours(
    const Map& map, const MapPoint& point, const std::vector<std::vector<int>>& neighbours) const {
  std::vector<NewObservation> found;
  const MapObservation& reference = point.observations[ReferenceOf(map, point)];
  const PatchView reference_view = ViewOf(map, reference);
  for (const int keyframe : neighbours[reference.keyframe]) {
    const bool seen = std::any_of(point.observations.begin(), point.observations.end(),
                                  [&](const MapObservation& o) { return o.keyframe == keyframe; });
    if (seen) continue;
    const Rigid3& pose = map.keyframe(keyframe).cam_from_world;
    const auto projection =
        PredictProjection(map, point, {&map.features(keyframe), &undistorter_, pose});
    if (!projection || projection->level >= static_cast<int>(pyramids_[keyframe].levels.size())) {
      continue;
    }
    const auto start = undistorter_.camera().ImageFromCamera(pose * point.position);
    if (!start) continue;
    const PatchView target{&pyramids_[keyframe], pose, *start, projection->level};
    const auto pixel = refiner_.Align(reference_view, target, point.position, point.normal);
    const auto undistorted = pixel ? undistorter_.Undistort(*pixel) : std::nullopt;
    if (!undistorted || IsMasked(masks_[keyframe], *pixel)) continue;
    Keypoint keypoint;
    keypoint.pixel = pixel->cast<float>();
    keypoint.undistorted = undistorted->cast<float>();
    keypoint.level = static_cast<uint8_t>(projection->level);
    keypoint.sigma = static_cast<float>(map.aligned_sigma(projection->level));
    found.push_back({keyframe, keypoint});
  }
  return found;
}

int PatchPass::ExtendTracks(Map& map) const {
  std::vector<std::vector<int>> neighbours(static_cast<size_t>(map.num_keyframes()));
  ParallelFor(neighbours.size(), num_threads_, [&](size_t k) {
    if (!map.keyframe(static_cast<int>(k)).alive) return;
    for (const auto& [shared, other] : map.Covisible(static_cast<int>(k))) {
      if (static_cast<int>(neighbours[k].size()) == options_.neighbours) break;
      neighbours[k].push_back(other);
    }
  });
  std::vector<std::vector<NewObservation>> found(static_cast<size_t>(map.num_points()));
  ParallelFor(found.size(), num_threads_, [&](size_t p) {
    const MapPoint& point = map.point(static_cast<int>(p));
    if (point.alive) found[p] = FindInNeighbours(map, point, neighbours);
  });
  int count = 0;
  for (int p = 0; p < map.num_points(); ++p) {
    for (const NewObservation& o : found[p]) {
      if (map.features(o.keyframe).IsFull()) continue;
      const int keypoint = map.AddKeypoint(o.keyframe, o.keypoint, map.point(p).descriptor);
      count += map.AddObservation(p, {o.keyframe, keypoint});
    }
  }
  for (int k = 0; k < map.num_keyframes(); ++k) {
    if (map.keyframe(k).alive) map.BuildGrid(k, undistorter_);
  }
  return count;
}

void PatchPass::AlignFrame(int frame, const ImagePyramid& pyramid, Map& map,
                           const Rigid3& cam_from_world, std::vector<PointMatch>& matches) const {
  std::vector<PointMatch> aligned;
  for (const PointMatch& match : matches) {
    const MapPoint& point = map.point(match.point);
    const Keypoint& keypoint = map.frame(frame).keypoint(match.keypoint);
    const PatchView reference = ViewOf(map, point.observations[ReferenceOf(map, point)]);
    const PatchView target{&pyramid, cam_from_world, keypoint.pixel.cast<double>(), keypoint.level};
    const auto pixel = refiner_.Align(reference, target, point.position, point.normal);
    const auto undistorted = pixel ? undistorter_.Undistort(*pixel) : std::nullopt;
    if (!undistorted) continue;
    map.MoveKeypoint(frame, match.keypoint, *pixel, *undistorted,
                     map.aligned_sigma(keypoint.level));
    aligned.push_back(match);
  }
  const double share = static_cast<double>(aligned.size()) / static_cast<double>(matches.size());
  if (share >= kMinAlignedShare) matches.swap(aligned);
}

}  // namespace s3lam
