#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "s3lam/slam/map.h"

namespace s3lam {

/// Descriptor distances (of 256 bits) for a match that place makes likely, and for one that only
/// looks decide.
inline constexpr int kLooseDescriptorDistance = 100;
inline constexpr int kStrictDescriptorDistance = 50;

/// Where an image is and what it can see, for projecting points into it.
struct FrameView {
  const FrameFeatures* features = nullptr;
  const Undistorter* undistorter = nullptr;
  Rigid3 cam_from_world;
};

/// A map point's predicted place in an image.
struct Projection {
  Eigen::Vector2d xy = Eigen::Vector2d::Zero();  // px, undistorted
  int level = 0;
  double view_cosine = 1.0;  // Between its mean viewing direction and this one.
};

/// Empty if the point is behind, outside the image, seen from too far aside (more than 60 degrees)
/// or at a scale that the pyramid does not have.
std::optional<Projection> PredictProjection(const Map& map, const MapPoint& point,
                                            const FrameView& view);

struct ProjectionSearch {
  double radius_px = 15.0;  // On level 0; times the predicted level's scale.
  int levels_below = 1;
  int levels_above = 1;
  int max_distance = kLooseDescriptorDistance;
  double max_ratio = 0.9;  // Best to second best of the same level.
};

/// For every point the keypoint nearest in descriptor within its search window. Keypoints with
/// taken[i] != 0 are left out; of two points on one keypoint the more similar one stays. Points by
/// index; the result is in ascending order of keypoints.
std::vector<PointMatch> MatchByProjection(const Map& map, std::span<const int> points,
                                          const FrameView& view, std::span<const uint8_t> taken,
                                          const ProjectionSearch& search);

/// A keypoint in each of two frames.
struct KeypointMatch {
  int a = kNoIndex;
  int b = kNoIndex;
};

/// Drops the matches that turned in the image against the majority. `angles` holds, per match, the
/// angle of its one keypoint minus that of the other [rad].
void KeepConsistentRotations(std::span<const float> angles, std::vector<KeypointMatch>& matches);

/// Nearest descriptors, both ways, with a ratio test; no use of place.
std::vector<KeypointMatch> MatchDescriptors(const FrameFeatures& a, const FrameFeatures& b,
                                            std::span<const int> keypoints_a,
                                            std::span<const int> keypoints_b, int max_distance,
                                            double max_ratio);

/// The same, without the matches that turned in the image against the majority.
std::vector<KeypointMatch> MatchByLooks(const FrameFeatures& a, const FrameFeatures& b,
                                        std::span<const int> keypoints_a,
                                        std::span<const int> keypoints_b, int max_distance,
                                        double max_ratio);

}  // namespace s3lam
