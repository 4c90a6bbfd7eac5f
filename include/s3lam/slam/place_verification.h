#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "s3lam/geometry/similarity3.h"
#include "s3lam/slam/matcher.h"

namespace s3lam {

struct PlaceVerificationOptions {
  int min_pairs = 30;
  double min_found_share = 0.25;
  int min_support = 3;
  int neighbours = 10;
  uint64_t seed = 0;  // Of the samples drawn; from the command line.

  void Visit(OptionVisitor& v);
};

/// A keyframe of a map; two of them may be of the same map or of different ones.
struct PlaceView {
  const Map* map = nullptr;
  int keyframe = kNoIndex;
};

/// Two keyframes that see the same place.
struct PlaceMatch {
  int keyframe_a = kNoIndex;
  int keyframe_b = kNoIndex;
  Similarity3 a_from_b;                     // Camera a from camera b.
  Similarity3 world_a_from_world_b;         // By it, the world of b's map.
  std::vector<std::pair<int, int>> points;  // The same point as map a and map b have it.
  double found_share = 0.0;  // Of the points that should be seen, those that were; the worse way.
  int support = 0;           // Neighbours of both that see the other's points as well.
};

/// Do the two keyframes see the same place? Their points are matched by descriptors, a similarity
/// is fitted, more points of both neighbourhoods are looked for with it, both ways. It must put
/// many points right, leave few unfound of those that should be in view (which a repeated object or
/// texture would), and hold for neighbouring keyframes, which had no say in it.
std::optional<PlaceMatch> VerifyPlace(const PlaceVerificationOptions& options,
                                      const Undistorter& undistorter, const PlaceView& a,
                                      const PlaceView& b);

/// A camera pose as a similarity of scale one.
inline Similarity3 ToSimilarity(const Rigid3& pose) {
  return {1.0, pose.rotation, pose.translation};
}

}  // namespace s3lam
