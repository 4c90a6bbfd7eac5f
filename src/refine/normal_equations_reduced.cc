// The reduced system of NormalEquations: what is left after the points are eliminated.

#include <Eigen/Cholesky>

#include "s3lam/base/parallel.h"
#include "s3lam/refine/manifolds.h"
#include "s3lam/refine/normal_equations.h"

namespace s3lam {

/// B_ii + D^2 without the terms that touch no point. The held direction, which no residual of the
/// projected system depends on, gets a value of its own, and zero on the right side.
Eigen::MatrixXd NormalEquations::DampedBlock(int i) const {
  const int size = layout_.size[i];
  Eigen::MatrixXd block = Eigen::MatrixXd::Zero(size, size);
  if (layout_.IsPose(i)) {
    block = pose_hessian_[i];
    if (i == layout_.held_pose) {
      block += (pose_hessian_[i].trace() / 6.0) * held_direction_ * held_direction_.transpose();
    }
  } else if (layout_.IsPlane(i)) {
    block = plane_hessian_[i - layout_.num_poses];
  } else if (layout_.IsCamera(i)) {
    block = camera_hessian_[i - layout_.first_camera()];
  }
  block.diagonal() += damping_.segment(layout_.offset[i], size);
  return block;
}

void NormalEquations::FillReduced(BlockMatrix& matrix) const {
  ForRows([&](int first, int last) {
    // Place of each variable's block in the panel at hand.
    std::vector<int> place(static_cast<size_t>(layout_.num_variables()), 0);
    for (int i = first; i < last; ++i) {
      for (size_t k = matrix.begin(i); k < matrix.end(i); ++k) {
        place[matrix.block(k)] = matrix.place(k);
      }
      auto panel = matrix.panel(i);
      panel.setZero();
      panel.topRows(layout_.size[i]) = DampedBlock(i);
      if (layout_.IsPose(i)) {
        FillPoseRow(i, place, matrix);
      } else if (layout_.IsPlane(i)) {
        FillPlaneRow(i, place, matrix);
      } else if (layout_.IsCamera(i)) {
        FillCameraRow(i, place, matrix);
      }
    }
  });
  for (const LinearTerm& term : linear_terms_) {
    for (size_t a = 0; a < term.variables.size(); ++a) {
      for (size_t b = 0; b < term.variables.size(); ++b) {
        const int i = term.variables[a];
        const int j = term.variables[b];
        if (j < i) continue;
        matrix.panel(i).middleRows(matrix.PlaceOf(j, i), layout_.size[j]) +=
            term.jacobians[b].transpose() * term.jacobians[a];
      }
    }
  }
}

/// - U_b U_a^T for all observations a of the pose and b of the same point, b's pose not before.
void NormalEquations::FillPoseRow(int i, const std::vector<int>& place, BlockMatrix& matrix) const {
  const auto stride = static_cast<size_t>(matrix.panel_rows(i));
  double* panel = matrix.panel(i).data();
  using Block = Eigen::Map<Matrix6, 0, Eigen::OuterStride<>>;
  if (const int j = CameraVariable(layout_.pose_of_variable[i]); j >= 0) {
    matrix.panel(i).middleRows(place[j], layout_.size[j]) += camera_by_pose_[i];
  }
  for (size_t k = layout_.pose_begin[i]; k < layout_.pose_begin[i + 1]; ++k) {
    const size_t a = layout_.of_pose[k];
    const int point = problem_.observations[a].point;
    const Eigen::Matrix<double, 3, 6> u_a = u_[a].transpose();
    for (size_t b = layout_.observation_begin[point]; b < layout_.observation_begin[point + 1];
         ++b) {
      const int j = layout_.variable_of_pose[problem_.observations[b].pose];
      if (j < i) continue;
      Block(panel + place[j], Eigen::OuterStride<>(static_cast<Eigen::Index>(stride))).noalias() -=
          u_[b] * u_a;
    }
    for (size_t c = layout_.term_begin[point]; c < layout_.term_begin[point + 1]; ++c) {
      const int j = layout_.variable_of_plane[problem_.points_on_planes[c].plane];
      if (j < 0) continue;
      const Eigen::Matrix<double, 1, 6> row = normal_[c].transpose() * u_a;
      Eigen::Map<Eigen::Matrix<double, 3, 6>, 0, Eigen::OuterStride<>>(
          panel + place[j], Eigen::OuterStride<>(static_cast<Eigen::Index>(stride)))
          .noalias() -= by_plane_[c] * row;
    }
    for (size_t c = layout_.seen_begin[point]; c < layout_.seen_begin[point + 1]; ++c) {
      const int j = layout_.seen[c].variable;
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 6>, 0, Eigen::OuterStride<>>(
          panel + place[j], layout_.size[j], 6,
          Eigen::OuterStride<>(static_cast<Eigen::Index>(stride))) -= seen_[c].lazyProduct(u_a);
    }
  }
}

void NormalEquations::FillPlaneRow(int i, const std::vector<int>& place,
                                   BlockMatrix& matrix) const {
  auto panel = matrix.panel(i);
  const int plane = i - layout_.num_poses;
  for (size_t k = layout_.plane_begin[plane]; k < layout_.plane_begin[plane + 1]; ++k) {
    const size_t a = layout_.of_plane[k];
    const int point = problem_.points_on_planes[a].point;
    for (size_t b = layout_.term_begin[point]; b < layout_.term_begin[point + 1]; ++b) {
      const int j = layout_.variable_of_plane[problem_.points_on_planes[b].plane];
      if (j < i) continue;
      panel.middleRows<3>(place[j]).noalias() -=
          (normal_[b].dot(normal_[a]) * by_plane_[b]) * by_plane_[a].transpose();
    }
    for (size_t c = layout_.seen_begin[point]; c < layout_.seen_begin[point + 1]; ++c) {
      const int j = layout_.seen[c].variable;
      panel.middleRows(place[j], layout_.size[j]) -=
          (seen_[c] * normal_[a]).lazyProduct(by_plane_[a].transpose());
    }
  }
}

void NormalEquations::FillCameraRow(int i, const std::vector<int>& place,
                                    BlockMatrix& matrix) const {
  auto panel = matrix.panel(i);
  const int camera = i - layout_.first_camera();
  for (size_t k = layout_.camera_begin[camera]; k < layout_.camera_begin[camera + 1]; ++k) {
    const size_t a = layout_.of_camera[k];
    const int point = layout_.seen[a].point;
    for (size_t b = layout_.seen_begin[point]; b < layout_.seen_begin[point + 1]; ++b) {
      const int j = layout_.seen[b].variable;
      if (j < i) continue;
      panel.middleRows(place[j], layout_.size[j]) -= seen_[b].lazyProduct(seen_[a].transpose());
    }
  }
}

Eigen::VectorXd NormalEquations::ReducedRightSide() const {
  Eigen::VectorXd right = -gradient_c_;
  ForRows([&](int first, int last) {
    for (int i = first; i < last; ++i) {
      const int offset = layout_.offset[i];
      if (layout_.IsPose(i)) {
        for (size_t k = layout_.pose_begin[i]; k < layout_.pose_begin[i + 1]; ++k) {
          const size_t a = layout_.of_pose[k];
          right.segment<6>(offset).noalias() +=
              u_[a] * reduced_gradient_[problem_.observations[a].point];
        }
      } else if (layout_.IsPlane(i)) {
        const int plane = i - layout_.num_poses;
        for (size_t k = layout_.plane_begin[plane]; k < layout_.plane_begin[plane + 1]; ++k) {
          const size_t a = layout_.of_plane[k];
          right.segment<3>(offset) +=
              normal_[a].dot(reduced_gradient_[problem_.points_on_planes[a].point]) * by_plane_[a];
        }
      } else if (layout_.IsCamera(i)) {
        const int camera = i - layout_.first_camera();
        for (size_t k = layout_.camera_begin[camera]; k < layout_.camera_begin[camera + 1]; ++k) {
          const size_t a = layout_.of_camera[k];
          right.segment(offset, layout_.size[i]) +=
              seen_[a] * reduced_gradient_[layout_.seen[a].point];
        }
      }
    }
  });
  return right;
}

/// U^T x, summed over a point's observations and planes.
Eigen::Vector3d NormalEquations::TimesTransposed(size_t p, const Eigen::VectorXd& x) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (size_t k = layout_.observation_begin[p]; k < layout_.observation_begin[p + 1]; ++k) {
    const int i = layout_.variable_of_pose[problem_.observations[k].pose];
    if (i >= 0) sum.noalias() += u_[k].transpose() * x.segment<6>(layout_.offset[i]);
  }
  for (size_t k = layout_.term_begin[p]; k < layout_.term_begin[p + 1]; ++k) {
    const int i = layout_.variable_of_plane[problem_.points_on_planes[k].plane];
    if (i >= 0) sum += by_plane_[k].dot(x.segment<3>(layout_.offset[i])) * normal_[k];
  }
  for (size_t k = layout_.seen_begin[p]; k < layout_.seen_begin[p + 1]; ++k) {
    const int i = layout_.seen[k].variable;
    sum += seen_[k].transpose() * x.segment(layout_.offset[i], layout_.size[i]);
  }
  return sum;
}

Eigen::VectorXd NormalEquations::MultiplyReduced(const Eigen::VectorXd& x) const {
  std::vector<Eigen::Vector3d> of_point(problem_.points.size(), Eigen::Vector3d::Zero());
  ParallelFor(layout_.num_chunks(), options_.num_threads, [&](size_t chunk) {
    for (size_t p = layout_.chunk_begin[chunk]; p < layout_.chunk_begin[chunk + 1]; ++p) {
      if (layout_.IsUsed(p)) of_point[p] = TimesTransposed(p, x);
    }
  });
  Eigen::VectorXd y(layout_.num_rows());
  ForRows([&](int first, int last) {
    for (int i = first; i < last; ++i) {
      const int offset = layout_.offset[i];
      y.segment(offset, layout_.size[i]) = DampedBlock(i) * x.segment(offset, layout_.size[i]);
      if (layout_.IsPose(i)) {
        for (size_t k = layout_.pose_begin[i]; k < layout_.pose_begin[i + 1]; ++k) {
          const size_t a = layout_.of_pose[k];
          y.segment<6>(offset).noalias() -= u_[a] * of_point[problem_.observations[a].point];
        }
      } else if (layout_.IsPlane(i)) {
        const int plane = i - layout_.num_poses;
        for (size_t k = layout_.plane_begin[plane]; k < layout_.plane_begin[plane + 1]; ++k) {
          const size_t a = layout_.of_plane[k];
          y.segment<3>(offset) -=
              normal_[a].dot(of_point[problem_.points_on_planes[a].point]) * by_plane_[a];
        }
      } else if (layout_.IsCamera(i)) {
        const int camera = i - layout_.first_camera();
        for (size_t k = layout_.camera_begin[camera]; k < layout_.camera_begin[camera + 1]; ++k) {
          const size_t a = layout_.of_camera[k];
          y.segment(offset, layout_.size[i]) -= seen_[a] * of_point[layout_.seen[a].point];
        }
      }
    }
  });
  for (size_t i = 0; i < camera_by_pose_.size(); ++i) {
    const int camera = CameraVariable(layout_.pose_of_variable[i]);
    if (camera < 0) continue;
    auto y_camera = y.segment(layout_.offset[camera], layout_.size[camera]);
    y_camera += camera_by_pose_[i] * x.segment<6>(layout_.offset[i]);
    y.segment<6>(layout_.offset[i]) +=
        camera_by_pose_[i].transpose() * x.segment(layout_.offset[camera], layout_.size[camera]);
  }
  for (const LinearTerm& term : linear_terms_) {
    Eigen::VectorXd product = Eigen::VectorXd::Zero(term.residual.size());
    for (size_t a = 0; a < term.variables.size(); ++a) {
      const int i = term.variables[a];
      product += term.jacobians[a] * x.segment(layout_.offset[i], layout_.size[i]);
    }
    for (size_t a = 0; a < term.variables.size(); ++a) {
      const int i = term.variables[a];
      y.segment(layout_.offset[i], layout_.size[i]) += term.jacobians[a].transpose() * product;
    }
  }
  return y;
}

std::vector<Eigen::MatrixXd> NormalEquations::InverseDiagonalBlocks() const {
  std::vector<Eigen::MatrixXd> blocks(static_cast<size_t>(layout_.num_variables()));
  for (int i = 0; i < layout_.num_variables(); ++i) blocks[i] = DampedBlock(i);
  for (const LinearTerm& term : linear_terms_) {
    for (size_t a = 0; a < term.variables.size(); ++a) {
      blocks[term.variables[a]] += term.jacobians[a].transpose() * term.jacobians[a];
    }
  }
  ForRows([&](int first, int last) {
    for (int i = first; i < last; ++i) {
      Eigen::MatrixXd schur = blocks[i];
      if (layout_.IsPose(i)) {
        for (size_t k = layout_.pose_begin[i]; k < layout_.pose_begin[i + 1]; ++k) {
          const Matrix63& u = u_[layout_.of_pose[k]];
          schur.noalias() -= u * u.transpose();
        }
      } else if (layout_.IsPlane(i)) {
        const int plane = i - layout_.num_poses;
        for (size_t k = layout_.plane_begin[plane]; k < layout_.plane_begin[plane + 1]; ++k) {
          const size_t a = layout_.of_plane[k];
          schur -= normal_[a].squaredNorm() * by_plane_[a] * by_plane_[a].transpose();
        }
      } else if (layout_.IsCamera(i)) {
        const int camera = i - layout_.first_camera();
        for (size_t k = layout_.camera_begin[camera]; k < layout_.camera_begin[camera + 1]; ++k) {
          const CameraRows<3>& u = seen_[layout_.of_camera[k]];
          schur -= u * u.transpose();
        }
      }
      // With a point seen twice by one image the sum above is not the block of the matrix and may
      // be indefinite; any positive block will do.
      const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(schur.rows(), schur.cols());
      const Eigen::LLT<Eigen::MatrixXd> llt(schur);
      blocks[i] = llt.info() == Eigen::Success ? llt.solve(identity).eval()
                                               : blocks[i].llt().solve(identity).eval();
    }
  });
  return blocks;
}

NormalEquations::Step NormalEquations::Apply(const Eigen::VectorXd& step, double slack,
                                             const BundleState& state, BundleState& moved) const {
  MoveStructure(step, state, moved);
  const std::vector<Eigen::Matrix3d> rotations = RotationMatrices(moved.poses);
  std::vector<Step> parts(layout_.num_chunks());
  moved.points = state.points;
  ParallelFor(parts.size(), options_.num_threads, [&](size_t chunk) {
    Step& part = parts[chunk];
    for (size_t p = layout_.chunk_begin[chunk]; p < layout_.chunk_begin[chunk + 1]; ++p) {
      if (!layout_.IsUsed(p)) continue;
      const Eigen::Vector3d right = -reduced_gradient_[p] - TimesTransposed(p, step);
      const Eigen::Vector3d change =
          factor_[p].transpose().triangularView<Eigen::Upper>().solve(right);
      const Eigen::Vector3d damping = hessian_[p].diagonal() / radius_;
      part.model_decrease +=
          0.5 * (damping.cwiseProduct(change).dot(change) - gradient_[p].dot(change));
      part.squared_norm += change.squaredNorm();
      part.squared_state_norm += state.points[p].squaredNorm();
      part.cost += MovePoint(p, change, rotations, moved);
    }
  });
  Step result;
  for (const Step& part : parts) {
    result.model_decrease += part.model_decrease;
    result.squared_norm += part.squared_norm;
    result.squared_state_norm += part.squared_state_norm;
    result.cost += part.cost;
  }
  // (B + D_c^2) dc + W dp = -g_c - slack's residual, so -g dc - 1/2 dc (B dc + W dp) is this.
  result.model_decrease +=
      0.5 * (damping_.cwiseProduct(step).dot(step) - gradient_c_.dot(step) + slack);
  result.squared_norm += step.squaredNorm();
  result.cost += StructureCost(moved);
  return result;
}

/// A point whose rays are nearly parallel may be sent behind a camera or far off by a step that
/// does all others good. It goes part of the way then, or stays, instead of having the whole step
/// refused for its sake. Returns its cost.
double NormalEquations::MovePoint(size_t p, const Eigen::Vector3d& change,
                                  const std::vector<Eigen::Matrix3d>& rotations,
                                  BundleState& moved) const {
  constexpr double kWorse = 1.0;  // [sigma^2]; below, a rise is the price of the others' fall.
  const Eigen::Vector3d start = moved.points[p];
  moved.points[p] = start + change;
  double cost = PointCost(p, moved.points[p], rotations, moved);
  if (cost <= cost_[p] + kWorse) return cost;
  for (const double part : {0.25, 0.0}) {
    const Eigen::Vector3d shorter = start + part * change;
    const double shorter_cost = PointCost(p, shorter, rotations, moved);
    if (shorter_cost < cost) {
      cost = shorter_cost;
      moved.points[p] = shorter;
    }
  }
  return cost;
}

void NormalEquations::MoveStructure(const Eigen::VectorXd& step, const BundleState& state,
                                    BundleState& moved) const {
  moved.poses = state.poses;
  moved.planes = state.planes;
  moved.height = state.height;
  moved.camera_params = state.camera_params;
  const PoseManifold pose_manifold;
  for (int i = 0; i < layout_.num_poses; ++i) {
    const int pose = layout_.pose_of_variable[i];
    const double* x = state.poses[pose].data();
    const Eigen::Matrix<double, 6, 1> delta = step.segment<6>(layout_.offset[i]);
    if (i != layout_.held_pose) {
      pose_manifold.Plus(x, delta.data(), moved.poses[pose].data());
      continue;
    }
    const Rigid3 held = FromPoseBlock(x);
    const Eigen::Vector3d from =
        FromPoseBlock(state.poses[problem_.gauge.fixed_pose].data()).CenterInB();
    const Eigen::Vector3d arm = held.CenterInB() - from;
    Eigen::Matrix<double, 5, 1> angles;  // v = -R dC; the part along the arm is dropped.
    angles << delta.head<3>(), -TangentBasis(arm.normalized()).transpose() *
                                   (held.rotation.conjugate() * delta.tail<3>()) / arm.norm();
    HeldDistancePoseManifold(from).Plus(x, angles.data(), moved.poses[pose].data());
  }
  const AnchoredPlaneManifold plane_manifold;
  for (int k = 0; k < layout_.num_planes; ++k) {
    const int plane = layout_.plane_of_variable[k];
    plane_manifold.Plus(state.planes[plane].data(),
                        step.data() + layout_.offset[layout_.num_poses + k],
                        moved.planes[plane].data());
  }
  if (layout_.height_variable >= 0) moved.height += step[layout_.offset[layout_.height_variable]];
  for (int k = 0; k < layout_.num_cameras; ++k) {
    const int camera = layout_.camera_of_variable[k];
    const int first = layout_.offset[layout_.first_camera() + k];
    const std::vector<int>& free = problem_.free_camera_params[camera];
    for (size_t f = 0; f < free.size(); ++f) {
      moved.camera_params[camera][free[f]] += step[first + static_cast<Eigen::Index>(f)];
    }
  }
}

}  // namespace s3lam
