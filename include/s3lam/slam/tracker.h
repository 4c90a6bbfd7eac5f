#pragma once

#include <optional>
#include <vector>

#include "s3lam/slam/matcher.h"

namespace s3lam {

struct TrackerOptions {
  double motion_radius_px = 15.0;
  double map_radius_px = 3.0;
  int min_inliers = 25;
  int max_local_keyframes = 25;
  double keyframe_ratio = 0.85;
  double min_coverage = 0.8;
  int max_keyframe_gap = 30;
  uint64_t seed = 0;  // Of the samples drawn; from the command line.

  void Visit(OptionVisitor& v);
};

/// Where a frame is and what it sees. Poses hang on a keyframe, so they move with the map.
struct FrameTrack {
  bool tracked = false;
  Rigid3 cam_from_world;              // At the time of tracking.
  int reference_keyframe = kNoIndex;  // Shares the most points.
  Rigid3 cam_from_reference;
  std::vector<PointMatch> matches;  // Inliers.
  std::vector<int> missed;          // Points that should have been seen and were not.

  template <typename A>
  void Transfer(A& archive) {
    archive(tracked, cam_from_world.rotation, cam_from_world.translation, reference_keyframe,
            cam_from_reference.rotation, cam_from_reference.translation, matches, missed);
  }
};

/// The pose of a tracked frame in the map as it is now.
Rigid3 CurrentPose(const Map& map, const FrameTrack& track);

/// Localises single frames in a map. Holds no state between frames.
class Tracker {
 public:
  Tracker(const TrackerOptions& options, const Undistorter& undistorter)
      : options_(options), undistorter_(undistorter) {}

  /// Follows the points of `last` into `frame`, `predicted` being where the motion so far puts it,
  /// or finds it by looks if that gives few; then looks for the local map. Not tracked if in vain.
  FrameTrack Track(const Map& map, int frame, const FrameTrack& last,
                   const Rigid3& predicted) const;

  /// Finds a frame by descriptors alone against the points of one keyframe, then as above. Tracked
  /// only if more of what should be visible is there than chance would find.
  FrameTrack Relocalize(const Map& map, int frame, int keyframe) const;

  /// Matches the local map around a pose that is nearly right.
  FrameTrack TrackLocalMap(const Map& map, int frame, const Rigid3& cam_from_world,
                           const std::vector<PointMatch>& matches, double radius_px) const;

  /// The motion of a frame that lies between two that were tracked, or beside one: matches what
  /// `near` sees around a guess, widely first.
  FrameTrack TrackNear(const Map& map, int frame, const FrameTrack& near,
                       const Rigid3& guess) const;

  /// Refines a pose with matches and keeps the inliers among them, whose number is returned.
  int Refine(const Map& map, int frame, Rigid3& cam_from_world,
             std::vector<PointMatch>& matches) const;

  /// Does the map need this frame as a keyframe: does it see too few of the points of its reference
  /// keyframe, or is there too little of the map in parts of the image that have keypoints? The
  /// second is what tells when the camera turns to what is not mapped yet: the number of matches
  /// may still be high then, all of them on one side, where they hold the pose badly.
  [[nodiscard]] bool NeedsKeyframe(const Map& map, int frame, const FrameTrack& track,
                                   int frames_since_keyframe) const;

 private:
  [[nodiscard]] std::vector<PointMatch> FollowMatches(const Map& map, int frame,
                                                      const FrameTrack& last,
                                                      const Rigid3& predicted,
                                                      double radius_px) const;
  /// Share of the cells of a grid over the image with keypoints in which there is a match.
  [[nodiscard]] double Coverage(const FrameFeatures& features,
                                const std::vector<PointMatch>& matches) const;
  /// Pose and inlier matches against one keyframe's points, by descriptors.
  [[nodiscard]] std::optional<std::pair<Rigid3, std::vector<PointMatch>>> FindByDescriptors(
      const Map& map, int frame, int keyframe) const;

  const TrackerOptions& options_;
  const Undistorter& undistorter_;
};

}  // namespace s3lam
