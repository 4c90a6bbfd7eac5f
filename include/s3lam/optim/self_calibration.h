#pragma once

#include <Eigen/Core>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/geometry/camera.h"
#include "s3lam/geometry/rigid3.h"

namespace s3lam {

struct SelfCalibrationOptions {
  bool enabled = true;
  double min_cost_decrease = 0.04;
  int max_observations = 30000;
  int max_iterations = 25;

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
  };
  std::vector<Observation> observations;
};

struct SelfCalibrationReport {
  bool accepted = false;
  double cost_decrease = 0.0;  // Share of the cost that the given distortion left unexplained.
  Camera camera;               // As given, or refined.
};

/// Does the lens distortion of a camera explain what it saw? Adjusts poses and points with the
/// distortion held and with it free (focal length and principal point stay as calibrated); the
/// refined camera is accepted if that removes at least min_cost_decrease of the cost. Pinhole and
/// one- or two-parameter models become OPENCV. Rectified images often keep a little distortion,
/// which bends monocular trajectories: where the calibration is right, the gain is about one
/// percent.
SelfCalibrationReport RefineDistortion(const SelfCalibrationOptions& options, const Camera& camera,
                                       const CalibrationProblem& problem);

}  // namespace s3lam
