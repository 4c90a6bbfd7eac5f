#pragma once

#include <vector>

#include "s3lam/optim/bundle_adjustment.h"
#include "s3lam/slam/tracker.h"

namespace s3lam {

struct MapperOptions {
  int triangulation_neighbours = 10;
  double min_parallax_deg = 1.0;
  double min_baseline_ratio = 0.01;
  double min_found_ratio = 0.25;
  int local_keyframes = 15;
  int min_shared_points = 15;
  double redundant_share = 0.9;
  BundleAdjustmentOptions local_ba{.max_iterations = 6};
  BundleAdjustmentOptions global_ba{.max_iterations = 30};

  void Visit(OptionVisitor& v);
};

/// Grows and prunes the map when a keyframe is added. Holds the points that are still on probation;
/// everything else is in the map.
class Mapper {
 public:
  Mapper(const MapperOptions& options, const Undistorter& undistorter)
      : options_(options), undistorter_(undistorter) {}

  /// Makes a tracked frame a keyframe: its matches become observations, new points are triangulated
  /// with its neighbours, duplicates fused, the neighbourhood adjusted, redundant keyframes
  /// removed. Returns the keyframe.
  int AddKeyframe(Map& map, int frame, const FrameTrack& track);

  /// Adjusts all keyframes and points, and removes observations that are off by more than
  /// `max_sigma` of their standard deviations (the default leaves 5 % out), until none is or
  /// `rounds` are done.
  void AdjustGlobally(Map& map, int rounds, int num_threads, double max_sigma = 2.4477) const;

  /// Triangulates keypoints of one keyframe that have no point with those of its neighbours;
  /// returns the new points.
  std::vector<int> TriangulateNewPoints(Map& map, int keyframe, int num_neighbours) const;

  /// Looks for the points of the neighbours in the keyframe and the other way round; adds
  /// observations and merges points that are the same.
  void FuseWithNeighbours(Map& map, int keyframe, int num_neighbours) const;

  /// Looks for these points in a keyframe; adds observations and merges what is the same.
  void FuseInto(Map& map, const std::vector<int>& points, int keyframe) const;

  template <typename A>
  void Transfer(A& archive) {
    archive(recent_points_);
  }

 private:
  void CullRecentPoints(Map& map, int keyframe);
  void AdjustLocally(Map& map, int keyframe) const;
  void CullKeyframes(Map& map, int keyframe) const;
  int TriangulatePair(Map& map, int keyframe, int neighbour, std::vector<int>& created) const;

  const MapperOptions& options_;
  const Undistorter& undistorter_;
  std::vector<int> recent_points_;
};

}  // namespace s3lam
