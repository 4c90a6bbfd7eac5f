#pragma once

#include <vector>

#include "s3lam/slam/pipeline.h"

namespace s3lam::slam {

/// Localises single frames in a finished map; safe to call from several threads.
class FrameLocalizer {
 public:
  FrameLocalizer(const Tracker& tracker, const Map& map, const std::vector<FrameTrack>& tracks,
                 const std::vector<int>& keyframe_of_frame);

  /// A keyframe's pose and matches are the map's own; another frame is matched anew, from where it
  /// was tracked or, if it was not, from where its neighbours in time put it; then it must see as
  /// much as a frame that is tracked. Without matches if not found.
  [[nodiscard]] FrameTrack Localize(int frame) const;

 private:
  [[nodiscard]] FrameTrack FromKeyframe(int keyframe) const;
  [[nodiscard]] FrameTrack FromNeighbours(int frame) const;

  const Tracker& tracker_;
  const Map& map_;
  const std::vector<FrameTrack>& tracks_;
  const std::vector<int>& keyframe_of_frame_;
};

/// The finished map as a model. Point and image ids are counted from 1; colours are sampled in the
/// keyframes.
Model Export(const Input& input, const Camera& camera, const Map& map,
             const std::vector<FrameTrack>& localized);

/// Figures of a model, and of the frames localised in it.
MapReport DescribeMap(const Model& model, const MapBuilder& builder,
                      const std::vector<FrameTrack>& localized);
/// Of the points that a frame sees, in its camera; 0 if it sees none.
double MedianDepth(const Map& map, const FrameTrack& track);
FrameReport DescribeFrame(const Undistorter& undistorter, const Map& map, int frame,
                          const FrameTrack& track);

}  // namespace s3lam::slam
