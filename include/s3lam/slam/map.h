#pragma once

#include <Eigen/Core>
#include <vector>

#include "s3lam/geometry/rigid3.h"
#include "s3lam/geometry/similarity3.h"
#include "s3lam/slam/features.h"

namespace s3lam {

/// Keyframes and points as the SLAM pass grows and prunes them. Indices are stable: what is removed
/// stays in its place, not alive.

inline constexpr int kNoIndex = -1;

struct Keyframe {
  int frame = kNoIndex;  // Index into the frames' features.
  Rigid3 cam_from_world;
  std::vector<int> point_of_keypoint;  // kNoIndex where a keypoint has no point.
  bool alive = true;
  // Once removed, it moves with another keyframe.
  int anchor = kNoIndex;
  Rigid3 cam_from_anchor;

  template <typename A>
  void Transfer(A& archive) {
    archive(frame, cam_from_world.rotation, cam_from_world.translation, point_of_keypoint, alive,
            anchor, cam_from_anchor.rotation, cam_from_anchor.translation);
  }
};

struct MapObservation {
  int keyframe = kNoIndex;
  int keypoint = kNoIndex;
};

/// A keypoint of a frame and the map point it sees.
struct PointMatch {
  int keypoint = kNoIndex;
  int point = kNoIndex;
};

struct MapPoint {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // in world
  std::vector<MapObservation> observations;            // Ascending keyframes, each at most once.
  BinaryDescriptor descriptor{};                       // The observation most like the others.
  Eigen::Vector3d view_direction =
      Eigen::Vector3d::Zero();  // Mean, from cameras to the point, unit.
  /// Of the surface [in world, away from the cameras, unit]; zero where it was not estimated.
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  double level0_distance = 0.0;  // Distance at which it would be seen on level 0 [map units].
  int first_keyframe = kNoIndex;
  int num_visible = 1;  // Frames that should have seen it,
  int num_found = 1;    // and those that did.
  int replaced_by = kNoIndex;
  bool alive = true;

  template <typename A>
  void Transfer(A& archive) {
    archive(position, observations, descriptor, view_direction, normal, level0_distance,
            first_keyframe, num_visible, num_found, replaced_by, alive);
  }
};

class Map {
 public:
  /// `frames` outlives the map, which may move their keypoints.
  Map(std::vector<FrameFeatures>& frames, const FeatureOptions& options);
  Map(const Map&) = default;
  Map(Map&&) = default;
  /// From a map of the same frames, e.g. an earlier state of this one.
  Map& operator=(const Map& other);
  ~Map() = default;

  [[nodiscard]] int num_keyframes() const { return static_cast<int>(keyframes_.size()); }
  [[nodiscard]] int num_points() const { return static_cast<int>(points_.size()); }
  [[nodiscard]] const Keyframe& keyframe(int i) const { return keyframes_[i]; }
  [[nodiscard]] const MapPoint& point(int i) const { return points_[i]; }
  [[nodiscard]] const FrameFeatures& features(int keyframe) const {
    return frames_[keyframes_[keyframe].frame];
  }
  [[nodiscard]] const FrameFeatures& frame(int frame) const { return frames_[frame]; }
  [[nodiscard]] const Keypoint& keypoint(const MapObservation& o) const {
    return features(o.keyframe).keypoint(o.keypoint);
  }
  [[nodiscard]] int num_levels() const { return static_cast<int>(level_sigmas_.size()); }
  [[nodiscard]] double sigma(int level) const { return level_sigmas_[level]; }
  /// Of one level to the next.
  [[nodiscard]] double log_scale_factor() const { return log_scale_factor_; }
  /// Standard deviation of keypoints aligned by patches on a level [px], or of all levels; none
  /// before there are any.
  [[nodiscard]] double aligned_sigma(int level) const { return aligned_sigmas_[level]; }
  [[nodiscard]] const std::vector<double>& aligned_sigmas() const { return aligned_sigmas_; }

  void SetPose(int keyframe, const Rigid3& cam_from_world) {
    keyframes_[keyframe].cam_from_world = cam_from_world;
  }
  /// For a keyframe whose surroundings became larger by `factor`: what hangs on it does as well.
  void ScaleAnchored(int keyframe, double factor) {
    keyframes_[keyframe].cam_from_anchor.translation *= factor;
  }
  void SetPosition(int point, const Eigen::Vector3d& position) {
    points_[point].position = position;
  }
  void CountVisible(int point, bool found) {
    ++points_[point].num_visible;
    points_[point].num_found += found;
  }

  /// By level, of the keypoints to be aligned from now on [px].
  void SetAlignedSigmas(std::vector<double> sigmas) { aligned_sigmas_ = std::move(sigmas); }
  void SetNormal(int point, const Eigen::Vector3d& normal) { points_[point].normal = normal; }

  /// See FrameFeatures::Move.
  void MoveKeypoint(int frame, int keypoint, const Eigen::Vector2d& pixel,
                    const Eigen::Vector2d& undistorted, double sigma) {
    frames_[frame].Move(keypoint, pixel, undistorted, sigma);
  }

  void SetSigma(const MapObservation& o, double sigma) {
    frames_[keyframes_[o.keyframe].frame].SetSigma(o.keypoint, sigma);
  }

  /// A keypoint that was not detected, but found by its point's patch.
  int AddKeypoint(int keyframe, const Keypoint& keypoint, const BinaryDescriptor& descriptor) {
    keyframes_[keyframe].point_of_keypoint.push_back(kNoIndex);
    return frames_[keyframes_[keyframe].frame].Add(keypoint, descriptor);
  }
  /// To be called after the last AddKeypoint.
  void BuildGrid(int keyframe, const Undistorter& undistorter) {
    frames_[keyframes_[keyframe].frame].BuildGrid(undistorter);
  }

  int AddKeyframe(int frame, const Rigid3& cam_from_world);
  /// A point without observations yet.
  int AddPoint(const Eigen::Vector3d& position, int first_keyframe);
  /// Does nothing if the keyframe sees the point already or the keypoint is taken; says if it did.
  bool AddObservation(int point, MapObservation observation);
  /// Erases the point as well when fewer than two observations are left.
  void RemoveObservation(int point, int keyframe);
  void ErasePoint(int point);
  /// What hangs on the keyframe hangs on its most covisible neighbour from then on.
  void EraseKeyframe(int keyframe);
  /// Erases keyframes that see fewer points than `min_points`, the weakest first, but leaves two;
  /// returns how many it erased.
  int EraseWeakKeyframes(int min_points);
  /// Moves the observations of `dropped` to `kept` where they do not collide.
  void MergePoints(int kept, int dropped);
  /// Takes the keyframes and points of another map of the same frames over, moved into this world.
  /// Their indices here are those there plus the numbers that this map had before.
  void Append(const Map& other, const Similarity3& this_from_other);
  /// Descriptor, viewing direction and distance from the observations.
  void UpdateAppearance(int point);
  void UpdateGeometry(int point);

  /// Everything a keyframe sees, by ascending keypoint.
  [[nodiscard]] std::vector<PointMatch> MatchesOf(int keyframe) const;
  [[nodiscard]] std::vector<int> AliveKeyframes() const;
  /// The same in the order of their frames.
  [[nodiscard]] std::vector<int> KeyframesInTime() const;
  [[nodiscard]] size_t NumObservations() const;
  /// The alive keyframe that a removed one moves with; itself while it is alive.
  [[nodiscard]] int AnchorOf(int keyframe) const;
  /// Pose of a keyframe, removed or not, in the map as it is now.
  [[nodiscard]] Rigid3 PoseOf(int keyframe) const;
  /// The alive point that took the place of this one; kNoIndex if it was erased.
  [[nodiscard]] int Resolve(int point) const;
  /// Keyframes that share points with this one as (shared points, keyframe), most first.
  [[nodiscard]] std::vector<std::pair<int, int>> Covisible(int keyframe) const;
  /// Points of a keyframe that at least `min_observations` keyframes see.
  [[nodiscard]] int CountPoints(int keyframe, int min_observations) const;
  /// Median depth of a keyframe's points; 0 without any.
  [[nodiscard]] double MedianDepth(int keyframe) const;

  /// Without the frames' features, which are the sequence's.
  template <typename A>
  void Transfer(A& archive) {
    archive(keyframes_, points_, aligned_sigmas_);
  }

 private:
  std::vector<FrameFeatures>& frames_;
  std::vector<double> level_sigmas_;
  double log_scale_factor_;
  std::vector<Keyframe> keyframes_;
  std::vector<MapPoint> points_;
  std::vector<double> aligned_sigmas_;
};

/// Points that these keyframes see, ascending.
std::vector<int> PointsOf(const Map& map, const std::vector<int>& keyframes);

}  // namespace s3lam
