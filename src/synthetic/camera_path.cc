#include "s3lam/synthetic/camera_path.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"

namespace s3lam {
namespace {

// Uniform cubic B-spline at parameter s in [0, 1] over the whole curve; it goes on as its ends do.
Eigen::Vector3d EvaluateSpline(const std::vector<Eigen::Vector3d>& knots, double s) {
  const double spans = static_cast<double>(knots.size()) - 3.0;
  const double x = s * spans;
  const double span = std::clamp(std::floor(x), 0.0, spans - 1.0);
  const double t = x - span;
  const size_t k = static_cast<size_t>(span);
  const double r = 1.0 - t;
  return (r * r * r * knots[k] + (3.0 * t * t * t - 6.0 * t * t + 4.0) * knots[k + 1] +
          (3.0 * r * r * r - 6.0 * r * r + 4.0) * knots[k + 2] + t * t * t * knots[k + 3]) /
         6.0;
}

Eigen::Matrix3d LookAt(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Eigen::Vector3d forward = (to - from).normalized();
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Matrix3d world_from_camera;
  world_from_camera << right, forward.cross(right), forward;
  return world_from_camera;
}

}  // namespace

CameraPath::CameraPath(std::vector<Eigen::Vector3d> positions, std::vector<Eigen::Vector3d> targets,
                       double duration_s, const Shake& shake, uint64_t seed)
    : positions_(std::move(positions)), targets_(std::move(targets)), duration_s_(duration_s) {
  S3LAM_CHECK(positions_.size() >= 4 && positions_.size() == targets_.size());
  S3LAM_CHECK(duration_s > 0.0);
  const Rng rng(seed);
  rotation_waves_ = MakeWaves(shake.rotation_rad, shake.frequency_hz, rng.Fork(1).Bits());
  translation_waves_ = MakeWaves(shake.translation_m, shake.frequency_hz, rng.Fork(2).Bits());
}

void CameraPath::SetDuration(double duration_s) {
  S3LAM_CHECK(duration_s > 0.0);
  duration_s_ = duration_s;
}

std::vector<CameraPath::Wave> CameraPath::MakeWaves(double amplitude, double frequency_hz,
                                                    uint64_t seed) {
  constexpr int kNumWaves = 4;
  Rng rng(seed);
  std::vector<Wave> waves;
  for (int i = 0; i < kNumWaves; ++i) {
    Wave wave;
    for (int axis = 0; axis < 3; ++axis) {
      // Higher frequencies have smaller amplitudes, so that the speed stays natural.
      const double factor = std::pow(1.7, i - 1) * rng.Uniform(0.8, 1.25);
      wave.omega[axis] = 2.0 * std::numbers::pi * frequency_hz * factor;
      wave.amplitude[axis] = amplitude * rng.Uniform(0.5, 1.0) / std::max(1.0, factor * factor);
      wave.phase[axis] = rng.Uniform(0.0, 2.0 * std::numbers::pi);
    }
    waves.push_back(wave);
  }
  return waves;
}

Eigen::Vector3d CameraPath::Sum(const std::vector<Wave>& waves, double time_s) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Wave& wave : waves) {
    for (int axis = 0; axis < 3; ++axis) {
      sum[axis] += wave.amplitude[axis] * std::sin(wave.omega[axis] * time_s + wave.phase[axis]);
    }
  }
  return sum;
}

Rigid3 CameraPath::WorldFromCamera(double time_s) const {
  S3LAM_CHECK(duration_s_ > 0.0);
  const Eigen::Vector3d position = EvaluateSpline(positions_, time_s / duration_s_);
  const Eigen::Vector3d target = EvaluateSpline(targets_, time_s / duration_s_);
  const Eigen::Quaterniond steady(LookAt(position, target));
  const Eigen::Quaterniond shake = QuaternionFromRotationVector(Sum(rotation_waves_, time_s));
  return {(steady * shake).normalized(), position + Sum(translation_waves_, time_s)};
}

}  // namespace s3lam
