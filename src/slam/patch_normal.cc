// The surface's normal around a point, from how its patches differ between views.

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <limits>

#include "patch_template.h"
#include "s3lam/geometry/plane.h"
#include "s3lam/slam/patch_refiner.h"

namespace s3lam {
namespace {

constexpr int kMaxIterations = 8;
constexpr double kConverged = 0.02;   // Change of the slopes.
constexpr double kMaxStep = 1.0;      // Of the slopes.
constexpr double kDifference = 0.01;  // Of the slopes, for the warps' derivatives.
constexpr double kSlopeSigma = 1.0;   // Of surfaces about facing the cameras (45 degrees).
constexpr double kPatchNoise = 8.0;   // Of what two views of a pixel differ by [grey levels].

using Vector5 = Eigen::Matrix<double, 5, 1>;
using Matrix5 = Eigen::Matrix<double, 5, 5>;

/// A target's patch in the optimisation; it is shifted and brightened on its own.
struct TargetPatch {
  const PatchView* view = nullptr;
  PatchRefiner::TargetRays rays;
  Eigen::Vector2d center = Eigen::Vector2d::Zero();  // px of the level
  double brightness = 0.0;
  // What the slopes' step moves shift and brightness by, and their step without it.
  Eigen::Matrix<double, 3, 2> coupling = Eigen::Matrix<double, 3, 2>::Zero();
  Eigen::Vector3d own_step = Eigen::Vector3d::Zero();
};

struct SlopeEquations {
  Eigen::Matrix2d hessian;
  Eigen::Vector2d gradient;
  double cost = 0.0;
};

/// Adds one target's patch to the equations of the slopes, with its shift and brightness
/// eliminated; `by_x`, `by_y`: change of the target's offsets by the slopes.
void AddPatch(const PatchTemplate& patch, const Eigen::Matrix2d& by_x, const Eigen::Matrix2d& by_y,
              TargetPatch& target, SlopeEquations& equations) {
  const cv::Mat& image = target.view->pyramid->levels[target.view->level];
  Matrix5 hessian = Matrix5::Zero();
  Vector5 gradient = Vector5::Zero();
  size_t k = 0;
  for (int v = -patch.half; v <= patch.half; ++v) {
    for (int u = -patch.half; u <= patch.half; ++u, ++k) {
      const Eigen::Vector2d slope = patch.gradients[k].cast<double>();
      const Eigen::Vector2d offset(u, v);
      const double residual = SampleImage(image, target.center.x() + u, target.center.y() + v) -
                              patch.values[k] - target.brightness;
      Vector5 j;
      j << -slope.dot(by_x * offset), -slope.dot(by_y * offset), slope, -1.0;
      hessian.selfadjointView<Eigen::Lower>().rankUpdate(j);
      gradient += residual * j;
      equations.cost += residual * residual / (kPatchNoise * kPatchNoise);
    }
  }
  hessian = Matrix5(hessian.selfadjointView<Eigen::Lower>()) / (kPatchNoise * kPatchNoise);
  gradient /= kPatchNoise * kPatchNoise;
  const Eigen::LDLT<Eigen::Matrix3d> own(hessian.bottomRightCorner<3, 3>());
  target.coupling = own.solve(hessian.bottomLeftCorner<3, 2>());
  target.own_step = own.solve(gradient.tail<3>());
  equations.hessian +=
      hessian.topLeftCorner<2, 2>() - hessian.topRightCorner<2, 3>() * target.coupling;
  equations.gradient += gradient.head<2>() - hessian.topRightCorner<2, 3>() * target.own_step;
}

}  // namespace

Eigen::Vector3d PatchRefiner::EstimateNormal(const PatchView& reference,
                                             std::span<const PatchView> targets,
                                             const Eigen::Vector3d& point,
                                             const Eigen::Vector3d& facing) const {
  const auto [side, up] = PlaneAxes(facing);
  const auto normal_of = [&, &side = side, &up = up](double x, double y) -> Eigen::Vector3d {
    return (facing + x * side + y * up).normalized();
  };
  std::vector<TargetPatch> patches;
  for (const PatchView& target : targets) {
    const auto rays = RaysOf(target, point);
    if (!rays) continue;
    TargetPatch& patch = patches.emplace_back();
    patch.view = &target;
    patch.rays = *rays;
    patch.center = target.pyramid->ToLevel(target.pixel, target.level);
  }
  if (patches.empty()) return facing;
  Eigen::Vector2d slopes = Eigen::Vector2d::Zero();
  Eigen::Vector3d best = facing;
  double best_cost = std::numeric_limits<double>::infinity();
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    SlopeEquations equations;
    equations.hessian = Eigen::Matrix2d::Identity() / (kSlopeSigma * kSlopeSigma);
    equations.gradient = slopes / (kSlopeSigma * kSlopeSigma);
    equations.cost = equations.gradient.dot(slopes);
    for (TargetPatch& target : patches) {
      const auto warp_at = [&](double x, double y) {
        return ReferenceFromTarget(reference, target.rays, point, normal_of(x, y));
      };
      const auto warp = warp_at(slopes.x(), slopes.y());
      const auto warp_x = warp_at(slopes.x() + kDifference, slopes.y());
      const auto warp_y = warp_at(slopes.x(), slopes.y() + kDifference);
      if (!warp || !warp_x || !warp_y) return best;
      const auto patch = WarpedPatch(reference, target.view->level, *warp);
      if (!patch || !IsInside(target.view->pyramid->levels[target.view->level], target.center,
                              patch->half + 1.0)) {
        return best;
      }
      const Eigen::Matrix2d inverse = warp->inverse() / kDifference;
      AddPatch(*patch, inverse * (*warp_x - *warp), inverse * (*warp_y - *warp), target, equations);
    }
    if (equations.cost >= best_cost) return best;
    best_cost = equations.cost;
    best = normal_of(slopes.x(), slopes.y());
    Eigen::Vector2d step = -equations.hessian.ldlt().solve(equations.gradient);
    if (!step.allFinite()) return best;
    step *= std::min(1.0, kMaxStep / std::max(step.norm(), 1e-12));
    for (TargetPatch& target : patches) {
      const Eigen::Vector3d own = -target.own_step - target.coupling * step;
      target.center += own.head<2>();
      target.brightness += own.z();
    }
    slopes += step;
    if (iteration > 0 && step.norm() < kConverged) break;
  }
  return best;
}

}  // namespace s3lam
