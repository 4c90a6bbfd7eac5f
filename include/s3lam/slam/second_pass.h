#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>

#include "s3lam/base/scratch_memory.h"
#include "s3lam/slam/mapper.h"
#include "s3lam/slam/patch_refiner.h"

namespace s3lam {

/// How far aligned observations are off, as their residuals show it once the camera is known.
struct AlignmentNoiseOptions {
  bool measured = true;
  double quantile = 0.9;
  int min_residuals = 200;
  double min_sigma_px = 0.05;
  double max_reprojection_sigma = 4.0;

  void Visit(OptionVisitor& v);
};

struct SecondPassOptions {
  int keyframe_features = 0;
  int rounds = 1;
  int neighbours = 20;
  bool extend_tracks = true;
  bool align_again = true;
  bool align_frames = true;
  PatchRefinerOptions patches;
  AlignmentNoiseOptions noise;

  void Visit(OptionVisitor& v);
};

/// What the passes over the keyframes read again, by frame.
struct FrameImages {
  std::function<cv::Mat(size_t)> read_gray;
  std::function<cv::Mat(size_t)> read_mask;  // May be empty: see ExtractFeatures.
};

/// Adds keypoints to the keyframes, which are few, until they have as many as the options say:
/// tracking all frames with so many would cost far more. Returns how many were added.
int AddKeyframeFeatures(const SecondPassOptions& options, FeatureOptions feature_options,
                        const Undistorter& undistorter, const FrameImages& images, int num_threads,
                        Map& map);

/// With the whole map at hand: every keyframe is matched against the points of all its neighbours
/// again, both ways, points that are the same merged, and what is still free triangulated.
void MatchAgain(const SecondPassOptions& options, const Mapper& mapper, Map& map);

/// Gives all observations of a map, which are aligned, the standard deviation that most residuals
/// on their level show, and those to be aligned from now on: where images are blurred it grows less
/// with the level than the size of a pixel does.
void MeasureAlignedSigmas(const AlignmentNoiseOptions& options, const Undistorter& undistorter,
                          Map& map);

/// Works on the images of the keyframes, which it holds, a pyramid each: in memory, or in a file
/// where that is too small. RefineObservations comes first: it estimates the normals of points,
/// which the others need.
class PatchPass {
 public:
  PatchPass(const SecondPassOptions& options, const FeatureOptions& feature_options,
            const Undistorter& undistorter, const FrameImages& images, int num_threads,
            const Map& map);

  /// Aligns every observation of a point with the one that looks most like the others; aligned ones
  /// move and get their smaller sigma, observations that do not align, or with what is masked, are
  /// removed.
  PatchRefinement RefineObservations(Map& map) const;

  /// Looks for every point, by its patch, in the neighbouring keyframes that should see it and have
  /// no keypoint for it, but not where those are masked; returns the number of observations found.
  int ExtendTracks(Map& map) const;

  /// Aligns what a frame that is no keyframe sees with the patches of the keyframes: keypoints move
  /// and get their smaller sigma. Matches that do not align are removed where most do; a blurred
  /// frame keeps them.
  void AlignFrame(int frame, const ImagePyramid& pyramid, Map& map, const Rigid3& cam_from_world,
                  std::vector<PointMatch>& matches) const;

 private:
  /// One point's normal and the aligned places of its observations; empty ones did not align.
  struct AlignedPoint {
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();
    std::vector<std::optional<Eigen::Vector2d>> pixels;
  };
  struct NewObservation {
    int keyframe = kNoIndex;
    Keypoint keypoint;
  };

  [[nodiscard]] PatchView ViewOf(const Map& map, const MapObservation& o) const;
  /// Of the surface around a point, from the views farthest from the reference observation's.
  [[nodiscard]] Eigen::Vector3d NormalOf(const Map& map, const MapPoint& point,
                                         size_t reference) const;
  [[nodiscard]] AlignedPoint AlignPoint(const Map& map, const MapPoint& point) const;
  [[nodiscard]] std::vector<NewObservation> FindInNeighbours(
      const Map& map, const MapPoint& point, const std::vector<std::vector<int>>& neighbours) const;

  const SecondPassOptions& options_;
  const Undistorter& undistorter_;
  int num_threads_;
  PatchRefiner refiner_;
  ScratchMemory pixels_;                // Of the pyramids.
  std::vector<ImagePyramid> pyramids_;  // By keyframe.
  std::vector<cv::Mat> masks_;          // By keyframe; empty where nothing is masked.
};

}  // namespace s3lam
