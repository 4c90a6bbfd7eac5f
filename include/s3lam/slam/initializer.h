#pragma once

#include <optional>
#include <span>
#include <vector>

#include "s3lam/slam/features.h"

namespace s3lam {

struct InitializerOptions {
  int num_starts = 40;
  int max_gap = 60;
  int min_matches = 60;
  int min_points = 50;
  double min_parallax_deg = 1.0;
  double good_parallax_deg = 1.5;
  int good_points = 150;
  uint64_t seed = 0;  // Of the samples drawn; from the command line.

  void Visit(OptionVisitor& v);
};

/// A point seen from both views of an initial pair.
struct InitialPoint {
  int keypoint_a = -1;
  int keypoint_b = -1;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // In camera a, median depth 1.

  template <typename A>
  void Transfer(A& archive) {
    archive(keypoint_a, keypoint_b, position);
  }
};

/// Two frames from which a map can start.
struct InitialPair {
  int frame_a = -1;
  int frame_b = -1;
  Rigid3 b_from_a;
  std::vector<InitialPoint> points;
  double parallax_deg = 0.0;         // Median over the points,
  double low_parallax_deg = 0.0;     // and what four fifths of them have.
  double mean_squared_error = 0.0;   // Over all tracks and views, in sigma, capped,
  double rotation_only_error = 0.0;  // and the same without any parallax.
  int num_other_motions = 0;         // That explain the tracks' ends as well, as on a plane,
  double other_error = 0.0;          // and the smallest of their errors, as above.

  template <typename A>
  void Transfer(A& archive) {
    archive(frame_a, frame_b, b_from_a.rotation, b_from_a.translation, points, parallax_deg,
            low_parallax_deg, mean_squared_error, rotation_only_error, num_other_motions,
            other_error);
  }
};

/// Looks for the best pair to start from, trying starting frames spread over the whole sequence in
/// order and, for each, ever larger gaps along which keypoints are followed. Candidate motions come
/// from essential matrix and homography; the one that explains two intermediate frames best, after
/// bundle adjustment, wins, which settles the planar ambiguity. A pair is good when it has parallax
/// and points enough and explains the images far better than a mere rotation does. Stops after the
/// first few starting frames that give a good one, else returns the best acceptable pair. If none
/// is, a search with more tries along the tracks, for half of min_parallax_deg, follows (fast,
/// straight drives), then one with a first step by looks alone and three views (images far apart).
/// Empty if that finds none (no parallax, too few matches). Threads change nothing.
std::optional<InitialPair> FindInitialPair(const InitializerOptions& options,
                                           std::span<const FrameFeatures> frames,
                                           const Undistorter& undistorter, int num_threads);

}  // namespace s3lam
