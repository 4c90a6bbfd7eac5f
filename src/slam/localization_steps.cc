#include "localization_steps.h"

#include "s3lam/base/log.h"
#include "s3lam/base/parallel.h"
#include "s3lam/slam/export.h"

namespace s3lam::slam {
namespace {

/// kNoIndex for frames that are none.
std::vector<int> KeyframeOfFrames(const Map& map, size_t num_frames) {
  std::vector<int> keyframe_of_frame(num_frames, kNoIndex);
  for (const int k : map.AliveKeyframes()) keyframe_of_frame[map.keyframe(k).frame] = k;
  return keyframe_of_frame;
}

/// Poses of the frames in a final map: keyframes as they are, others refined against it, by patches
/// too where keyframes are. Frames that belong to another map stay there.
std::vector<FrameTrack> LocalizeFrames(const Options& options, const Input& input,
                                       const Undistorter& undistorter, MapBuilder& builder,
                                       const std::vector<uint8_t>& belongs_elsewhere) {
  Map& map = builder.map();
  const std::vector<FrameTrack>& tracks = builder.tracks();
  const std::vector<int> keyframe_of_frame = KeyframeOfFrames(map, tracks.size());
  const FrameLocalizer localizer(builder.tracker(), map, tracks, keyframe_of_frame);
  const int read_threads = input.concurrent_reads ? options.num_threads : 1;
  std::optional<PatchPass> pass;
  if (options.second_pass.patches.enabled && options.second_pass.align_frames) {
    pass.emplace(options.second_pass, options.features, undistorter,
                 FrameImages{input.read_gray, {}}, read_threads, map);
  }
  std::vector<FrameTrack> localized(tracks.size());
  ParallelFor(tracks.size(), pass ? read_threads : options.num_threads, [&](size_t i) {
    if (belongs_elsewhere[i] != 0) return;
    const int frame = static_cast<int>(i);
    localized[i] = localizer.Localize(frame);
    if (!pass || localized[i].matches.empty() || keyframe_of_frame[i] != kNoIndex) return;
    const ImagePyramid pyramid = BuildPyramid(options.features, input.read_gray(i));
    pass->AlignFrame(frame, pyramid, map, localized[i].cam_from_world, localized[i].matches);
    builder.tracker().Refine(map, frame, localized[i].cam_from_world, localized[i].matches);
  });
  for (size_t i = 0; i < localized.size(); ++i) {
    if (keyframe_of_frame[i] != kNoIndex) continue;  // Part of the model in any case.
    FrameTrack& track = localized[i];
    track.tracked = static_cast<int>(track.matches.size()) >= options.min_localization_inliers;
    if (!track.tracked) track = {};
  }
  return localized;
}

void RefineFrames(const Options& options, MapBuilder& builder, std::vector<FrameTrack>& localized) {
  const Map& map = builder.map();
  const std::vector<int> keyframe_of_frame = KeyframeOfFrames(map, localized.size());
  ParallelFor(localized.size(), options.num_threads, [&](size_t i) {
    FrameTrack& track = localized[i];
    if (!track.tracked) return;
    if (const int k = keyframe_of_frame[i]; k != kNoIndex) {
      track.cam_from_world = map.keyframe(k).cam_from_world;
      track.matches = map.MatchesOf(k);
      return;
    }
    std::erase_if(track.matches,
                  [&](const PointMatch& match) { return !map.point(match.point).alive; });
    const int num_inliers =
        builder.tracker().Refine(map, static_cast<int>(i), track.cam_from_world, track.matches);
    if (num_inliers < options.min_localization_inliers) track = {};
  });
}

}  // namespace

void RefineInMaps(const Options& options, const Submaps& maps,
                  std::vector<std::vector<FrameTrack>>& localized) {
  for (size_t m = 0; m < maps.size(); ++m) RefineFrames(options, *maps[m], localized[m]);
}

void EraseWeakKeyframes(const Options& options, const Submaps& maps) {
  for (const auto& builder : maps) {
    const int num_erased = builder->map().EraseWeakKeyframes(options.min_localization_inliers);
    if (num_erased > 0) spdlog::info("{} keyframes see too little of the map", num_erased);
  }
}

std::vector<std::vector<FrameTrack>> LocalizeInMaps(const Options& options, const Input& input,
                                                    const Undistorter& undistorter,
                                                    const Submaps& maps, size_t num_frames) {
  std::vector<std::vector<FrameTrack>> localized;
  for (size_t m = 0; m < maps.size(); ++m) {
    std::vector<uint8_t> belongs_elsewhere(num_frames, 0);
    for (size_t i = 0; i < num_frames; ++i) {
      for (size_t other = 0; other < maps.size(); ++other) {
        if (other != m && maps[other]->tracks()[i].tracked) belongs_elsewhere[i] = 1;
        if (other < m && localized[other][i].tracked) belongs_elsewhere[i] = 1;
      }
    }
    localized.push_back(LocalizeFrames(options, input, undistorter, *maps[m], belongs_elsewhere));
  }
  return localized;
}

}  // namespace s3lam::slam
