#include "s3lam/refine/normal_equations.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "s3lam/base/parallel.h"
#include "s3lam/optim/huber.h"
#include "s3lam/refine/manifolds.h"
#include "s3lam/refine/projection.h"

namespace s3lam {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// Damping of a direction that no residual depends on.
constexpr double kMinDiagonal = 1e-30;
constexpr int kRowsPerItem = 16;

Eigen::Map<const Eigen::Vector3d> Translation(const PoseBlock& pose) {
  return Eigen::Map<const Eigen::Vector3d>(pose.data() + 4);
}

Eigen::Matrix3d RotationOf(const PoseBlock& pose) {
  return Eigen::Quaterniond(pose[3], pose[0], pose[1], pose[2]).toRotationMatrix();
}

double PlaneResidual(const BundleProblem& problem, const BundleState& state,
                     const PointOnPlane& term, const Eigen::Vector3d& point) {
  const Eigen::Vector4d& plane = state.planes[term.plane];
  const Eigen::Vector3d arm = point - problem.planes[term.plane].anchor_in_world;
  return (plane.head<3>().dot(arm) + plane[3]) / term.sigma;
}

}  // namespace

NormalEquations::NormalEquations(const BundleSolverOptions& options, const BundleProblem& problem,
                                 const std::vector<StructureTerm>& terms, const SchurLayout& layout)
    : options_(options),
      problem_(problem),
      terms_(terms),
      layout_(layout),
      u_(problem.observations.size()),
      normal_(problem.points_on_planes.size()),
      by_plane_(problem.points_on_planes.size()),
      seen_(layout.seen.size()),
      cost_(problem.points.size(), 0.0),
      hessian_(problem.points.size()),
      factor_(problem.points.size()),
      gradient_(problem.points.size()),
      reduced_gradient_(problem.points.size()) {}

std::vector<Eigen::Matrix3d> NormalEquations::RotationMatrices(
    const std::vector<PoseBlock>& poses) {
  std::vector<Eigen::Matrix3d> rotations;
  rotations.reserve(poses.size());
  for (const PoseBlock& pose : poses) rotations.push_back(RotationOf(pose));
  return rotations;
}

void NormalEquations::ForRows(const std::function<void(int, int)>& body) const {
  const int n = layout_.num_variables();
  ParallelFor(static_cast<size_t>((n + kRowsPerItem - 1) / kRowsPerItem), options_.num_threads,
              [&](size_t item) {
                const int first = static_cast<int>(item) * kRowsPerItem;
                body(first, std::min(n, first + kRowsPerItem));
              });
}

double NormalEquations::PointCost(size_t p, const Eigen::Vector3d& point,
                                  const std::vector<Eigen::Matrix3d>& rotations,
                                  const BundleState& state) const {
  double sum = 0.0;
  for (size_t k = layout_.observation_begin[p]; k < layout_.observation_begin[p + 1]; ++k) {
    const BundleObservation& o = problem_.observations[k];
    const int camera = problem_.camera_of_pose[o.pose];
    Eigen::Vector2d pixel;
    if (!ProjectPoint(problem_.cameras[camera].model, state.camera_params[camera].data(),
                      rotations[o.pose] * point + Translation(state.poses[o.pose]), &pixel,
                      nullptr)) {
      return kInfinity;
    }
    const double sigma = options_.sigma_px * o.sigma;
    sum += Huber((pixel - o.pixel).squaredNorm() / (sigma * sigma), options_.huber_reprojection);
  }
  for (size_t k = layout_.term_begin[p]; k < layout_.term_begin[p + 1]; ++k) {
    const double r = PlaneResidual(problem_, state, problem_.points_on_planes[k], point);
    sum += Huber(r * r, options_.huber_plane);
  }
  return 0.5 * sum;
}

double NormalEquations::Linearize(const BundleState& state) {
  rotations_ = RotationMatrices(state.poses);
  tangents_.clear();
  for (const auto& plane : state.planes) {
    tangents_.push_back(TangentBasis(Eigen::Vector3d(plane.head<3>())));
  }
  HoldScale(state);
  std::vector<Sums> sums(layout_.num_chunks());
  ParallelFor(sums.size(), options_.num_threads,
              [&](size_t chunk) { LinearizeChunk(state, chunk, sums[chunk]); });
  AddSums(sums);
  LinearizeStructure(state);
  double cost = StructureCost(state);
  for (const Sums& part : sums) cost += part.cost;
  return cost;
}

/// The tangent direction that would change the distance of the held camera's centre C to the
/// gauge's first one: C moves by -R^T v, so it is v along R (C - C_1).
void NormalEquations::HoldScale(const BundleState& state) {
  if (layout_.held_pose < 0) return;
  const Rigid3 pose =
      FromPoseBlock(state.poses[layout_.pose_of_variable[layout_.held_pose]].data());
  const Rigid3 first = FromPoseBlock(state.poses[problem_.gauge.fixed_pose].data());
  held_direction_.head<3>().setZero();
  held_direction_.tail<3>() = pose.rotation * (pose.CenterInB() - first.CenterInB()).normalized();
}

NormalEquations::Sums NormalEquations::ZeroSums() const {
  Sums sums;
  sums.pose_hessian.assign(static_cast<size_t>(layout_.num_poses), Matrix6::Zero());
  sums.pose_gradient.assign(static_cast<size_t>(layout_.num_poses), Vector6::Zero());
  sums.plane_hessian.assign(static_cast<size_t>(layout_.num_planes), Eigen::Matrix3d::Zero());
  sums.plane_gradient.assign(static_cast<size_t>(layout_.num_planes), Eigen::Vector3d::Zero());
  for (int i = layout_.first_camera(); i < layout_.num_variables(); ++i) {
    const int size = layout_.size[i];
    sums.camera_hessian.emplace_back(CameraRows<Eigen::Dynamic>::Zero(size, size));
    sums.camera_gradient.emplace_back(CameraRows<1>::Zero(size));
  }
  if (layout_.num_cameras == 0) return sums;
  for (const int pose : layout_.pose_of_variable) {
    const int variable = CameraVariable(pose);
    sums.camera_by_pose.emplace_back(
        CameraRows<6>::Zero(variable < 0 ? 0 : layout_.size[variable], 6));
  }
  return sums;
}

void NormalEquations::LinearizeChunk(const BundleState& state, size_t chunk, Sums& sums) {
  sums = ZeroSums();
  for (size_t p = layout_.chunk_begin[chunk]; p < layout_.chunk_begin[chunk + 1]; ++p) {
    if (!layout_.IsUsed(p)) continue;
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    const double cost_before = sums.cost;
    for (size_t k = layout_.seen_begin[p]; k < layout_.seen_begin[p + 1]; ++k) {
      seen_[k].setZero(layout_.size[layout_.seen[k].variable], 3);
    }
    for (size_t k = layout_.observation_begin[p]; k < layout_.observation_begin[p + 1]; ++k) {
      if (!LinearizeObservation(state, k, sums, hessian, gradient)) {
        sums.cost = kInfinity;
        return;
      }
    }
    for (size_t k = layout_.term_begin[p]; k < layout_.term_begin[p + 1]; ++k) {
      LinearizePlaneTerm(state, k, sums, hessian, gradient);
    }
    cost_[p] = 0.5 * (sums.cost - cost_before);
    hessian_[p] = hessian;
    gradient_[p] = gradient;
    factor_[p].setIdentity();
    if (problem_.IsConstantPoint(static_cast<int>(p))) HoldPoint(p);
  }
  sums.cost *= 0.5;
}

/// A point that nothing moves: no gradient, and no tie to any other variable.
void NormalEquations::HoldPoint(size_t p) {
  hessian_[p].setIdentity();
  gradient_[p].setZero();
  for (size_t k = layout_.observation_begin[p]; k < layout_.observation_begin[p + 1]; ++k) {
    u_[k].setZero();
  }
  for (size_t k = layout_.term_begin[p]; k < layout_.term_begin[p + 1]; ++k) normal_[k].setZero();
  for (size_t k = layout_.seen_begin[p]; k < layout_.seen_begin[p + 1]; ++k) seen_[k].setZero();
}

/// r = (proj(R X + t) - x) / sigma; the pose moves as in PoseManifold: d x_c = w x x_c + v.
bool NormalEquations::LinearizeObservation(const BundleState& state, size_t k, Sums& sums,
                                           Eigen::Matrix3d& hessian, Eigen::Vector3d& gradient) {
  const BundleObservation& o = problem_.observations[k];
  const int camera = problem_.camera_of_pose[o.pose];
  const Eigen::Matrix3d& rotation = rotations_[o.pose];
  const Eigen::Vector3d in_camera =
      rotation * state.points[o.point] + Translation(state.poses[o.pose]);
  Eigen::Vector2d pixel;
  Matrix23 projection;
  if (!ProjectPoint(problem_.cameras[camera].model, state.camera_params[camera].data(), in_camera,
                    &pixel, &projection)) {
    return false;
  }
  const double inverse_sigma = 1.0 / (options_.sigma_px * o.sigma);
  Eigen::Vector2d residual = (pixel - o.pixel) * inverse_sigma;
  const double squared = residual.squaredNorm();
  sums.cost += Huber(squared, options_.huber_reprojection);
  const double weight = HuberWeight(squared, options_.huber_reprojection);
  residual *= weight;
  projection *= weight * inverse_sigma;
  const Eigen::Matrix<double, 2, 3> by_point = projection * rotation;
  hessian.noalias() += by_point.transpose() * by_point;
  gradient.noalias() += by_point.transpose() * residual;
  const int variable = layout_.variable_of_pose[o.pose];
  Matrix26 by_pose = Matrix26::Zero();
  if (variable >= 0) {
    for (int row = 0; row < 2; ++row) {  // -a^T [x]_x = (x cross a)^T
      by_pose.row(row).head<3>() = in_camera.cross(Eigen::Vector3d(projection.row(row)));
    }
    by_pose.rightCols<3>() = projection;
    if (variable == layout_.held_pose) {
      const Eigen::Vector2d along = by_pose * held_direction_;
      by_pose.noalias() -= along * held_direction_.transpose();
    }
    sums.pose_hessian[variable].noalias() += by_pose.transpose() * by_pose;
    sums.pose_gradient[variable].noalias() += by_pose.transpose() * residual;
  }
  u_[k].noalias() = by_pose.transpose() * by_point;
  if (layout_.variable_of_camera[camera] >= 0) {
    const CameraRows<2> by_camera =
        (weight * inverse_sigma) * CameraJacobian(camera, state, in_camera);
    AddCamera(o, by_camera, residual, by_point, by_pose, sums);
  }
  return true;
}

/// d(pixel) / d(free parameters), transposed.
NormalEquations::CameraRows<2> NormalEquations::CameraJacobian(
    int camera, const BundleState& state, const Eigen::Vector3d& in_camera) const {
  const CameraModel model = problem_.cameras[camera].model;
  std::array<double, 2 * kMaxCameraParams> by_all;
  ProjectionParamsJacobian(model, state.camera_params[camera].data(), in_camera, by_all.data());
  const std::vector<int>& free = problem_.free_camera_params[camera];
  CameraRows<2> jacobian(static_cast<Eigen::Index>(free.size()), 2);
  for (size_t f = 0; f < free.size(); ++f) {
    jacobian.row(static_cast<Eigen::Index>(f)) << by_all[static_cast<size_t>(free[f])],
        by_all[static_cast<size_t>(CameraModelNumParams(model) + free[f])];
  }
  return jacobian;
}

/// What an observation tells about its camera, and how that goes with its point and its pose.
void NormalEquations::AddCamera(const BundleObservation& o, const CameraRows<2>& by_camera,
                                const Eigen::Vector2d& residual,
                                const Eigen::Matrix<double, 2, 3>& by_point,
                                const Matrix26& by_pose, Sums& sums) {
  const int variable = CameraVariable(o.pose);
  const int camera = variable - layout_.first_camera();
  sums.camera_hessian[camera] += by_camera.lazyProduct(by_camera.transpose());
  sums.camera_gradient[camera] += by_camera.lazyProduct(residual);
  const int pose = layout_.variable_of_pose[o.pose];
  if (pose >= 0) sums.camera_by_pose[pose] += by_camera.lazyProduct(by_pose);
  size_t k = layout_.seen_begin[o.point];
  while (layout_.seen[k].variable != variable) ++k;
  seen_[k] += by_camera.lazyProduct(by_point);
}

/// r = (n . (X - anchor) + h) / sigma; the plane moves as in AnchoredPlaneManifold.
void NormalEquations::LinearizePlaneTerm(const BundleState& state, size_t k, Sums& sums,
                                         Eigen::Matrix3d& hessian, Eigen::Vector3d& gradient) {
  const PointOnPlane& term = problem_.points_on_planes[k];
  const double residual = PlaneResidual(problem_, state, term, state.points[term.point]);
  sums.cost += Huber(residual * residual, options_.huber_plane);
  const double weight = HuberWeight(residual * residual, options_.huber_plane);
  const double scale = weight / term.sigma;
  const Eigen::Vector3d normal = state.planes[term.plane].head<3>();
  normal_[k] = scale * normal;
  hessian.noalias() += normal_[k] * normal_[k].transpose();
  gradient += (weight * residual) * normal_[k];
  const int variable = layout_.variable_of_plane[term.plane];
  if (variable < 0) return;
  const Eigen::Vector3d arm =
      state.points[term.point] - problem_.planes[term.plane].anchor_in_world;
  by_plane_[k] << scale * (tangents_[term.plane].transpose() * arm), scale;
  const int plane = variable - layout_.num_poses;
  sums.plane_hessian[plane].noalias() += by_plane_[k] * by_plane_[k].transpose();
  sums.plane_gradient[plane] += (weight * residual) * by_plane_[k];
}

void NormalEquations::AddSums(const std::vector<Sums>& sums) {
  pose_hessian_.assign(static_cast<size_t>(layout_.num_poses), Matrix6::Zero());
  plane_hessian_.assign(static_cast<size_t>(layout_.num_planes), Eigen::Matrix3d::Zero());
  Sums zero = ZeroSums();
  camera_hessian_ = std::move(zero.camera_hessian);
  camera_by_pose_ = std::move(zero.camera_by_pose);
  gradient_c_ = Eigen::VectorXd::Zero(layout_.num_rows());
  diagonal_ = Eigen::VectorXd::Zero(layout_.num_rows());
  ForRows([&](int first, int last) {
    for (int i = first; i < last; ++i) {
      const int offset = layout_.offset[i];
      if (layout_.IsPose(i)) {
        for (const Sums& part : sums) {
          pose_hessian_[i] += part.pose_hessian[i];
          gradient_c_.segment<6>(offset) += part.pose_gradient[i];
          if (!camera_by_pose_.empty()) camera_by_pose_[i] += part.camera_by_pose[i];
        }
        diagonal_.segment<6>(offset) = pose_hessian_[i].diagonal();
      } else if (layout_.IsPlane(i)) {
        const int plane = i - layout_.num_poses;
        for (const Sums& part : sums) {
          plane_hessian_[plane] += part.plane_hessian[plane];
          gradient_c_.segment<3>(offset) += part.plane_gradient[plane];
        }
        diagonal_.segment<3>(offset) = plane_hessian_[plane].diagonal();
      } else if (layout_.IsCamera(i)) {
        const int camera = i - layout_.first_camera();
        for (const Sums& part : sums) {
          camera_hessian_[camera] += part.camera_hessian[camera];
          gradient_c_.segment(offset, layout_.size[i]) += part.camera_gradient[camera];
        }
        diagonal_.segment(offset, layout_.size[i]) = camera_hessian_[camera].diagonal();
      }
    }
  });
}

bool NormalEquations::Damp(double radius) {
  radius_ = radius;
  damping_ = diagonal_.cwiseMax(kMinDiagonal) / radius;
  if (layout_.held_pose >= 0) {
    // Alike in all three directions of v, so that the held one stays apart from the others.
    auto shift = damping_.segment<3>(layout_.offset[layout_.held_pose] + 3);
    shift.setConstant(shift.mean());
  }
  std::vector<uint8_t> done(layout_.num_chunks(), 1);
  ParallelFor(done.size(), options_.num_threads, [&](size_t chunk) {
    for (size_t p = layout_.chunk_begin[chunk]; p < layout_.chunk_begin[chunk + 1]; ++p) {
      if (layout_.IsUsed(p) && !DampPoint(p, radius)) done[chunk] = 0;
    }
  });
  return std::find(done.begin(), done.end(), 0) == done.end();
}

bool NormalEquations::DampPoint(size_t p, double radius) {
  Eigen::Matrix3d damped = hessian_[p];
  damped.diagonal() += damped.diagonal().cwiseMax(kMinDiagonal) / radius;
  const Eigen::LLT<Eigen::Matrix3d> llt(damped);
  if (llt.info() != Eigen::Success) return false;
  const Eigen::Matrix3d factor = llt.matrixL();
  // What is stored holds the last damping's L_old: W = U_old L_old^T, so U = U_old (L_old^T L^-T).
  const Eigen::Matrix3d inverse =
      factor.triangularView<Eigen::Lower>().solve(Eigen::Matrix3d::Identity());
  const Eigen::Matrix3d change = factor_[p].transpose() * inverse.transpose();
  const Eigen::Matrix3d change_transposed = change.transpose();
  for (size_t k = layout_.observation_begin[p]; k < layout_.observation_begin[p + 1]; ++k) {
    u_[k] = (u_[k] * change).eval();
  }
  for (size_t k = layout_.term_begin[p]; k < layout_.term_begin[p + 1]; ++k) {
    normal_[k] = (change_transposed * normal_[k]).eval();
  }
  for (size_t k = layout_.seen_begin[p]; k < layout_.seen_begin[p + 1]; ++k) {
    seen_[k] = (seen_[k] * change).eval();
  }
  factor_[p] = factor;
  reduced_gradient_[p] = inverse * gradient_[p];
  return reduced_gradient_[p].allFinite();
}

}  // namespace s3lam
