#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/geometry/camera.h"
#include "s3lam/geometry/rigid3.h"

namespace s3lam {

struct SelfCalibrationOptions {
  bool enabled = true;
  double min_cost_decrease = 0.01;
  int max_observations = 30000;
  int max_iterations = 100;

  void Visit(OptionVisitor& v);
};

/// Poses, points and what a single camera saw of them, in original pixels.
struct CalibrationProblem {
  std::vector<Rigid3> poses;            // cam_from_world
  std::vector<Eigen::Vector3d> points;  // in world
  struct Observation {
    int pose = 0;
    int point = 0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // px, first pixel at 0.5
    double inverse_sigma = 1.0;                       // 1/px
    /// How far a readout time of the shutter would move it [px/s]; for RefineReadout alone.
    Eigen::Vector2d per_readout = Eigen::Vector2d::Zero();
  };
  std::vector<Observation> observations;
};

/// Part of the reprojection cost that another calibration must remove for the given one to be in
/// doubt. Where cameras are calibrated it is up to 2 %; with a principal point off by 1.5 % of the
/// image's width 4 to 37 %, with focal lengths off by 3 % from 1 (on a drive, which leaves them to
/// the scene's depth) to 36 %; see benchmarks/accuracy/wrong_cameras.py.
constexpr double kDoubtfulCostShare = 0.04;

struct SelfCalibrationReport {
  bool accepted = false;
  double cost_decrease = 0.0;  // Share of the cost that the given distortion left unexplained.
  Camera camera;               // As given, or refined.
  /// Share of the cost with a refined distortion that other focal lengths and another principal
  /// point, refined together with it, would remove, and these: fx, fy, cx, cy [px]; empty if the
  /// share is below kDoubtfulCostShare.
  double pinhole_cost_decrease = 0.0;
  std::vector<double> better_pinhole;
};

/// "focal lengths of ... and a principal point of ... would remove ... of the reprojection cost".
std::string DescribeBetterPinhole(const std::vector<double>& better_pinhole, double cost_decrease);

/// The same camera with a model that has the usual distortion terms: pinhole and one- or
/// two-parameter models become OPENCV, others stay as they are.
Camera WithDistortion(const Camera& camera);

/// Does the calibration of a camera explain what it saw? Adjusts poses and points with the radial
/// distortion held and with it free (all else stays as calibrated); the refined camera, see
/// WithDistortion, is accepted if that removes at least min_cost_decrease of the cost. Rectified
/// images often keep a little distortion, which bends monocular trajectories: a hundredth of the
/// cost is enough to tell, since a right calibration leaves about a thousandth. Then also with
/// focal lengths and principal point free, which are never accepted but told: not every motion
/// determines them.
SelfCalibrationReport CheckCalibration(const SelfCalibrationOptions& options, const Camera& camera,
                                       const CalibrationProblem& problem);

/// What is known of a focal length beforehand.
struct FocalPrior {
  double focal = 0.0;           // px
  double relative_sigma = 1.0;  // Of its logarithm.
};

/// A camera as its images determine it, and the map adjusted with it.
struct CameraRefinement {
  Camera camera;
  double focal_sigma = 0.0;  // px, by the sigmas of the observations and the prior
  /// Mean over the observations of how much better each is explained than an outlier is: 1 if all
  /// are explained exactly, 0 if none is.
  double mean_score = 0.0;
  std::vector<Rigid3> poses;            // As in the problem.
  std::vector<Eigen::Vector3d> points;  // As in the problem.
};

/// Adjusts a SIMPLE_RADIAL or RADIAL camera that is not calibrated together with all poses and
/// points. Priors (of the principal point: the centre of the image within some per cent of its
/// size) decide only where the motion does not determine the camera; without any rotation it does
/// not determine the focal length, and focal_sigma tells. Empty without observations or if the
/// solver fails.
std::optional<CameraRefinement> RefineIntrinsics(const SelfCalibrationOptions& options,
                                                 const Camera& camera, const FocalPrior& prior,
                                                 const CalibrationProblem& problem);

struct ReadoutRefinement {
  double readout_s = 0.0;
  double sigma_s = 0.0;        // By the sigmas of the observations.
  double cost_decrease = 0.0;  // Share of the cost that no readout time leaves unexplained.
};

/// The readout time of a rolling shutter that explains the observations best, adjusted together
/// with all poses and points: these may bend so that little of it is seen with them held. Empty
/// without observations or if the solver fails.
std::optional<ReadoutRefinement> RefineReadout(const SelfCalibrationOptions& options,
                                               const Camera& camera,
                                               const CalibrationProblem& problem);

/// What the focal lengths that five disjoint parts of the problem give, each of successive poses,
/// differ by beyond their sigmas, as a standard deviation of the focal length of the whole [px]. A
/// sigma holds independent noise only; what motion blur, a rolling shutter or an inexact distortion
/// do depends on motion and scene, and differs between the parts. Taken as a random effect of each
/// part (DerSimonian and Laird 1986). Poses, points and `camera` are those of the whole. 0 if fewer
/// than two parts give a focal length.
double FocalSigmaBetweenParts(const SelfCalibrationOptions& options, const Camera& camera,
                              const FocalPrior& prior, const CalibrationProblem& problem);

}  // namespace s3lam
