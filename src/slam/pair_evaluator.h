#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "s3lam/optim/bundle_adjustment.h"
#include "s3lam/slam/initializer.h"

namespace s3lam::internal {

constexpr int kViewsOfPair = 4;     // First, two between, last;
constexpr int kMinViewsOfPair = 3;  // or one between, where the two are that near.

/// A keypoint of the starting frame, followed.
struct Track {
  std::vector<int> keypoint_of_frame;  // By offset from the starting frame; -1 where not seen.
  Eigen::Vector2d position;
  Eigen::Vector2d velocity = Eigen::Vector2d::Zero();  // px per frame
  int missed = 0;
};

/// Makes maps of the tracks between two frames.
class PairEvaluator {
 public:
  PairEvaluator(const InitializerOptions& options, std::span<const FrameFeatures> frames,
                const Undistorter& undistorter)
      : options_(options), frames_(frames), camera_(undistorter.intrinsics()) {}

  /// The map that tracks from frame `start` to start + gap give, if they have the parallax.
  std::optional<InitialPair> Evaluate(int start, int gap, const std::vector<Track>& tracks);

 private:
  [[nodiscard]] int KeypointOf(const Track& track, int view) const {
    return track.keypoint_of_frame[views_[view] - views_[0]];
  }
  [[nodiscard]] std::optional<Eigen::Vector2d> Pixel(const Track& track, int view) const {
    const int keypoint = KeypointOf(track, view);
    if (keypoint < 0) return std::nullopt;
    return frames_[views_[view]].keypoint(keypoint).undistorted.cast<double>();
  }
  [[nodiscard]] double InverseSigma(const Track& track, int view) const {
    return 1.0 / frames_[views_[view]].keypoint(KeypointOf(track, view)).sigma;
  }

  /// At most kViewsOfPair, the others evenly between the first and the last.
  void ChooseViews(int start, int gap);
  [[nodiscard]] int NumViews() const { return static_cast<int>(views_.size()); }

  /// Triangulates from the outer views, poses the inner ones, adjusts, and scores over all tracks.
  [[nodiscard]] std::optional<InitialPair> EvaluateMotion(const Rigid3& b_from_a) const;

  /// The point of each track, -1 where no point explains its ends. A track without any parallax is
  /// none that a motion fails to explain: it gets a point far away, in its direction.
  std::vector<int> TriangulateTracks(const Rigid3& b_from_a, BaProblem& problem) const;

  /// Mean squared error, in sigma and capped, of the rotations and directions that fit the tracks
  /// best: what is left of them without any parallax.
  [[nodiscard]] double RotationOnlyError() const;

  [[nodiscard]] Eigen::Vector3d Bearing(const Eigen::Vector2d& pixel) const {
    return camera_.Normalize(pixel).homogeneous().normalized();
  }

  /// Where each track points to in the first view, averaged over all views.
  [[nodiscard]] std::vector<Eigen::Vector3d> MeanDirections(const std::vector<Rigid3>& turns) const;

  /// The rotation from these directions to what a view sees.
  [[nodiscard]] Rigid3 FitTurn(const std::vector<Eigen::Vector3d>& directions, int view) const;

  /// Rotation that takes bearings to bearings, fitted again to the half that agrees best.
  [[nodiscard]] Rigid3 FitRotation(const std::vector<Eigen::Vector3d>& from,
                                   const std::vector<Eigen::Vector3d>& to,
                                   const std::vector<Eigen::Vector2d>& pixels,
                                   const std::vector<double>& inverse_sigmas) const;

  bool PoseInnerViews(const std::vector<int>& point_of_track, BaProblem& problem) const;

  void AddObservations(const std::vector<int>& point_of_track, BaProblem& problem) const;

  [[nodiscard]] std::optional<InitialPair> Score(const std::vector<int>& point_of_track,
                                                 const BaProblem& problem) const;

  const InitializerOptions& options_;
  std::span<const FrameFeatures> frames_;
  PinholeIntrinsics camera_;
  std::vector<int> views_;
  std::vector<const Track*> tracks_;
};

}  // namespace s3lam::internal
