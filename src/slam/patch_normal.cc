// The surface's normal around a point, from how its patches differ between views.

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

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

}  // namespace

/// Gauss-Newton on the slopes of one point's surface against the plane that faces the cameras.
class NormalEstimator {
 public:
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

  NormalEstimator(const PatchRefiner& refiner, const PatchView& reference,
                  std::span<const PatchView> targets, const Eigen::Vector3d& point,
                  const Eigen::Vector3d& facing)
      : refiner_(refiner),
        reference_(reference),
        point_(point),
        facing_(facing),
        axes_(PlaneAxes(facing)) {
    for (const PatchView& target : targets) {
      const auto rays = refiner.RaysOf(target, point);
      if (!rays) continue;
      TargetPatch& patch = patches_.emplace_back();
      patch.view = &target;
      patch.rays = *rays;
      patch.center = target.pyramid->ToLevel(target.pixel, target.level);
    }
  }

  /// Ends where patches fit no better, leave their images or lose their texture: the best so far.
  Eigen::Vector3d Run() {
    Eigen::Vector3d best = facing_;
    if (patches_.empty()) return best;
    double best_cost = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
      const auto equations = Linearise();
      if (!equations || equations->cost >= best_cost) break;
      best_cost = equations->cost;
      best = NormalAt(slopes_);
      Eigen::Vector2d step = -equations->hessian.ldlt().solve(equations->gradient);
      if (!step.allFinite()) break;
      step *= std::min(1.0, kMaxStep / std::max(step.norm(), 1e-12));
      Move(step);
      if (iteration > 0 && step.norm() < kConverged) break;
    }
    return best;
  }

 private:
  [[nodiscard]] Eigen::Vector3d NormalAt(const Eigen::Vector2d& slopes) const {
    return (facing_ + slopes.x() * axes_.first + slopes.y() * axes_.second).normalized();
  }

  /// The equations of the slopes at their present values; empty if a patch cannot be had there.
  std::optional<SlopeEquations> Linearise() {
    SlopeEquations equations;
    equations.hessian = Eigen::Matrix2d::Identity() / (kSlopeSigma * kSlopeSigma);
    equations.gradient = slopes_ / (kSlopeSigma * kSlopeSigma);
    equations.cost = equations.gradient.dot(slopes_);
    for (TargetPatch& target : patches_) {
      if (!AddTarget(target, equations)) return std::nullopt;
    }
    return equations;
  }

  bool AddTarget(TargetPatch& target, SlopeEquations& equations) const;

  void Move(const Eigen::Vector2d& step) {
    for (TargetPatch& target : patches_) {
      const Eigen::Vector3d own = -target.own_step - target.coupling * step;
      target.center += own.head<2>();
      target.brightness += own.z();
    }
    slopes_ += step;
  }

  const PatchRefiner& refiner_;
  const PatchView& reference_;
  Eigen::Vector3d point_;
  Eigen::Vector3d facing_;
  std::pair<Eigen::Vector3d, Eigen::Vector3d> axes_;
  std::vector<TargetPatch> patches_;
  Eigen::Vector2d slopes_ = Eigen::Vector2d::Zero();
};

namespace {

/// Adds one target's patch to the equations of the slopes, with its shift and brightness
/// eliminated; `by_x`, `by_y`: change of the target's offsets by the slopes.
void AddPatch(const PatchTemplate& patch, const Eigen::Matrix2d& by_x, const Eigen::Matrix2d& by_y,
              NormalEstimator::TargetPatch& target, NormalEstimator::SlopeEquations& equations) {
  const cv::Mat& image = target.view->pyramid->levels[target.view->level];
  Eigen::VectorXf residual;
  PatchResidual(patch, image, target.center, static_cast<float>(target.brightness), residual);
  Eigen::Matrix<float, Eigen::Dynamic, 5> jacobian(residual.size(), 5);
  jacobian.rightCols<3>() = patch.jacobian;
  jacobian.col(4) *= -1.0F;
  const Eigen::Matrix2f move_x = by_x.cast<float>();
  const Eigen::Matrix2f move_y = by_y.cast<float>();
  Eigen::Index k = 0;
  for (int v = -patch.half; v <= patch.half; ++v) {
    for (int u = -patch.half; u <= patch.half; ++u, ++k) {
      const Eigen::Vector2f slope = patch.jacobian.row(k).head<2>().transpose();
      const Eigen::Vector2f offset(static_cast<float>(u), static_cast<float>(v));
      jacobian(k, 0) = -slope.dot(move_x * offset);
      jacobian(k, 1) = -slope.dot(move_y * offset);
    }
  }
  constexpr double kInformation = 1.0 / (kPatchNoise * kPatchNoise);
  const Matrix5 hessian = kInformation * (jacobian.transpose() * jacobian).eval().cast<double>();
  const Vector5 gradient = kInformation * (jacobian.transpose() * residual).eval().cast<double>();
  equations.cost += kInformation * static_cast<double>(residual.squaredNorm());
  const Eigen::LDLT<Eigen::Matrix3d> own(hessian.bottomRightCorner<3, 3>());
  target.coupling = own.solve(hessian.bottomLeftCorner<3, 2>());
  target.own_step = own.solve(gradient.tail<3>());
  equations.hessian +=
      hessian.topLeftCorner<2, 2>() - hessian.topRightCorner<2, 3>() * target.coupling;
  equations.gradient += gradient.head<2>() - hessian.topRightCorner<2, 3>() * target.own_step;
}

}  // namespace

bool NormalEstimator::AddTarget(TargetPatch& target, SlopeEquations& equations) const {
  const auto warp_at = [&](double x, double y) {
    return refiner_.ReferenceFromTarget(reference_, target.rays, point_,
                                        NormalAt(slopes_ + Eigen::Vector2d(x, y)));
  };
  const auto warp = warp_at(0.0, 0.0);
  const auto warp_x = warp_at(kDifference, 0.0);
  const auto warp_y = warp_at(0.0, kDifference);
  if (!warp || !warp_x || !warp_y) return false;
  const auto patch = refiner_.WarpedPatch(reference_, target.view->level, *warp);
  const cv::Mat& image = target.view->pyramid->levels[target.view->level];
  if (!patch || !IsInside(image, target.center, patch->half + 1.0)) return false;
  const Eigen::Matrix2d inverse = warp->linear.inverse() / kDifference;
  AddPatch(*patch, inverse * (warp_x->linear - warp->linear),
           inverse * (warp_y->linear - warp->linear), target, equations);
  return true;
}

Eigen::Vector3d PatchRefiner::EstimateNormal(const PatchView& reference,
                                             std::span<const PatchView> targets,
                                             const Eigen::Vector3d& point,
                                             const Eigen::Vector3d& facing) const {
  return NormalEstimator(*this, reference, targets, point, facing).Run();
}

}  // namespace s3lam
