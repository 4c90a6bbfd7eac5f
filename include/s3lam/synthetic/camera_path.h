#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "s3lam/geometry/rigid3.h"

namespace s3lam {

/// Unsteadiness of the hand or the vehicle: a sum of seeded sinusoids added to a path.
struct Shake {
  double rotation_rad = 0.0;  // Amplitude of each axis' strongest wave.
  double translation_m = 0.0;
  double frequency_hz = 1.0;  // Of the strongest wave; the others lie around it.
};

/// Where a camera is at each moment: uniform cubic B-splines (twice continuously differentiable)
/// through the neighbourhood of position and look-at knots, plus shake. World axes: z up, metres.
/// Camera axes: x right, y down, z forward.
class CameraPath {
 public:
  CameraPath() = default;
  /// `positions` and `targets` are control points (m), at least four each and equally many, spread
  /// evenly over [0, duration_s]. Throws std::logic_error otherwise.
  CameraPath(std::vector<Eigen::Vector3d> positions, std::vector<Eigen::Vector3d> targets,
             double duration_s, const Shake& shake, uint64_t seed);

  /// The camera at `time_s`. The path goes on shortly before 0 and after its duration, as far as
  /// an exposure reaches.
  [[nodiscard]] Rigid3 WorldFromCamera(double time_s) const;
  [[nodiscard]] double duration_s() const { return duration_s_; }
  /// The same path in another time; the shake keeps its frequencies.
  void SetDuration(double duration_s);

 private:
  struct Wave {
    Eigen::Vector3d amplitude, omega, phase;
  };
  static std::vector<Wave> MakeWaves(double amplitude, double frequency_hz, uint64_t seed);
  static Eigen::Vector3d Sum(const std::vector<Wave>& waves, double time_s);

  std::vector<Eigen::Vector3d> positions_, targets_;
  double duration_s_ = 0.0;
  std::vector<Wave> rotation_waves_, translation_waves_;
};

}  // namespace s3lam
