#include "s3lam/refine/covariance.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/SparseCholesky>
#include <nlohmann/json.hpp>

#include "s3lam/base/log.h"

namespace s3lam {
namespace {

using SparseMatrix = Eigen::SparseMatrix<double>;

/// As in TriangulationCovariances.
constexpr double kPointDamping = 1e-12;

/// Without what hangs on planes that no point lies on: such planes may be related to one another
/// only, and then nothing says where they are.
BundleProblem WithoutEmptyPlanes(const BundleProblem& problem) {
  std::vector<uint8_t> has_points(problem.planes.size(), 0);
  for (const PointOnPlane& term : problem.points_on_planes) has_points[term.plane] = 1;
  BundleProblem kept = problem;
  std::erase_if(kept.relations, [&](const RelationTerm& term) {
    return has_points[term.plane_a] == 0 || has_points[term.plane_b] == 0;
  });
  std::erase_if(kept.heights, [&](const HeightTerm& term) { return has_points[term.plane] == 0; });
  return kept;
}

/// Block-diagonal inverse of the points' own Hessian; false if a point is not determined.
bool InvertPointBlocks(const SparseMatrix& hessian, const std::vector<int>& begins,
                       int first_column, SparseMatrix& inverse) {
  std::vector<Eigen::Triplet<double>> triplets;
  triplets.reserve(static_cast<size_t>(3 * hessian.cols()));
  for (size_t k = 0; k < begins.size(); ++k) {
    const int begin = begins[k] - first_column;
    const int end =
        k + 1 < begins.size() ? begins[k + 1] - first_column : static_cast<int>(hessian.cols());
    Eigen::MatrixXd block = hessian.block(begin, begin, end - begin, end - begin);
    // Where the rays are nearly parallel the depth is unknown: the damping keeps it finite.
    block.diagonal().array() += kPointDamping * block.trace();
    const Eigen::LLT<Eigen::MatrixXd> factor(block);
    if (factor.info() != Eigen::Success) return false;
    const Eigen::MatrixXd inverted =
        factor.solve(Eigen::MatrixXd::Identity(block.rows(), block.cols()));
    for (int row = 0; row < inverted.rows(); ++row) {
      for (int col = 0; col < inverted.cols(); ++col) {
        triplets.emplace_back(begin + row, begin + col, inverted(row, col));
      }
    }
  }
  inverse.resize(hessian.rows(), hessian.cols());
  inverse.setFromTriplets(triplets.begin(), triplets.end());
  return true;
}

/// The Hessian of what is estimated beside the points, after these are eliminated.
std::optional<SparseMatrix> SchurComplement(const BundleLinearization& linear) {
  const auto columns = static_cast<int>(linear.jacobian.cols());
  const int others = linear.num_other_columns;
  const SparseMatrix by_others = linear.jacobian.leftCols(others);
  const SparseMatrix by_points = linear.jacobian.rightCols(columns - others);
  SparseMatrix schur = SparseMatrix(by_others.transpose()) * by_others;
  if (columns == others) return schur;
  const SparseMatrix points_transposed = by_points.transpose();
  SparseMatrix inverse;
  if (!InvertPointBlocks(points_transposed * by_points, linear.point_columns, others, inverse)) {
    return std::nullopt;
  }
  const SparseMatrix coupling = points_transposed * by_others;
  const SparseMatrix eliminated = inverse * coupling;
  schur -= SparseMatrix(coupling.transpose()) * eliminated;
  return schur;
}

/// Diagonal blocks of the inverse of a symmetric positive definite matrix.
class InverseBlocks {
 public:
  InverseBlocks(const SparseMatrix& matrix, int max_dense_rows) : size_(matrix.rows()) {
    if (size_ <= max_dense_rows) {
      const Eigen::LLT<Eigen::MatrixXd> factor{Eigen::MatrixXd(matrix)};
      ok_ = factor.info() == Eigen::Success;
      if (ok_) inverse_ = factor.solve(Eigen::MatrixXd::Identity(size_, size_));
    } else {
      factor_.compute(matrix);
      ok_ = factor_.info() == Eigen::Success && (factor_.vectorD().array() > 0.0).all();
    }
  }

  [[nodiscard]] bool ok() const { return ok_; }

  [[nodiscard]] Eigen::MatrixXd Block(int begin, int size) const {
    if (inverse_.size() > 0) return inverse_.block(begin, begin, size, size);
    Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(size_, size);
    unit.middleRows(begin, size).setIdentity();
    return factor_.solve(unit).middleRows(begin, size);
  }

 private:
  Eigen::Index size_;
  bool ok_ = false;
  Eigen::MatrixXd inverse_;
  Eigen::SimplicialLDLT<SparseMatrix> factor_;
};

}  // namespace

void CovarianceOptions::Visit(OptionVisitor& v) {
  v.Value("enabled", enabled, "write the covariances of poses and planes (covariance.json)");
  v.Value("max_dense_rows", max_dense_rows,
          "up to so many unknowns beside the points their whole covariance matrix is computed, "
          "beyond that block by block",
          1, 100000);
}

std::optional<BundleCovariance> ComputeCovariance(const CovarianceOptions& options,
                                                  const BundleSolverOptions& solver,
                                                  const BundleProblem& problem) {
  const BundleLinearization linear = LinearizeBundle(solver, WithoutEmptyPlanes(problem));
  BundleCovariance covariance;
  covariance.poses.resize(problem.poses.size());
  covariance.planes.resize(problem.planes.size());
  if (linear.num_other_columns == 0) return covariance;
  const auto schur = SchurComplement(linear);
  if (!schur) return std::nullopt;
  const InverseBlocks inverse(*schur, options.max_dense_rows);
  if (!inverse.ok()) return std::nullopt;
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    if (linear.pose_columns[i] < 0) continue;
    const Eigen::MatrixXd& full = linear.full_from_pose[i];
    covariance.poses[i] = full *
                          inverse.Block(linear.pose_columns[i], static_cast<int>(full.cols())) *
                          full.transpose();
  }
  for (size_t k = 0; k < problem.planes.size(); ++k) {
    if (linear.plane_columns[k] < 0) continue;
    covariance.planes[k] = inverse.Block(linear.plane_columns[k], 3);
  }
  return covariance;
}

nlohmann::json ToJson(const OutputCovariance& covariance, const Reconstruction& model) {
  const auto by_rows = [](const auto& matrix) {
    std::vector<double> values;
    for (int row = 0; row < matrix.rows(); ++row) {
      for (int col = 0; col < matrix.cols(); ++col) values.push_back(matrix(row, col));
    }
    return values;
  };
  nlohmann::json poses = nlohmann::json::array();
  for (const auto& [id, matrix] : covariance.poses) {
    poses.push_back({{"image_id", id.value()},
                     {"name", model.images.at(id).name},
                     {"covariance", by_rows(matrix)}});
  }
  nlohmann::json planes = nlohmann::json::array();
  for (const auto& [id, matrix] : covariance.planes) {
    planes.push_back({{"id", id.value()}, {"covariance", by_rows(matrix)}});
  }
  return {{"pose_order",
           {"rotation_x", "rotation_y", "rotation_z", "center_x", "center_y", "center_z"}},
          {"plane_order", {"rotation_u", "rotation_v", "shift"}},
          {"poses", std::move(poses)},
          {"planes", std::move(planes)}};
}

Matrix6d CenterCovariance(const Matrix6d& covariance, const Rigid3& cam_from_world,
                          const Similarity3& new_from_old) {
  // The centre moves by -R^T v and not with w (see PoseManifold).
  Matrix6d map = Matrix6d::Identity();
  map.bottomRightCorner<3, 3>() =
      -new_from_old.scale *
      (new_from_old.rotation * cam_from_world.rotation.conjugate()).toRotationMatrix();
  return map * covariance * map.transpose();
}

Eigen::Matrix3d SurfaceCovariance(const Eigen::Matrix3d& covariance, const AnchoredPlane& plane,
                                  const PlanarSurface& surface) {
  // dn = B (a, b) along the tangent axes; turning the normal n = u x v about u by r changes it by
  // -r v, about v by r u. The surface moves along n by -(dn . (c - anchor) + dh).
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(plane.parameters.head<3>());
  const Eigen::Vector3d arm = surface.centroid_in_world - plane.anchor_in_world;
  Eigen::Matrix3d map = Eigen::Matrix3d::Zero();
  map.block<1, 2>(0, 0) = -surface.axis_v_in_world.transpose() * basis;
  map.block<1, 2>(1, 0) = surface.axis_u_in_world.transpose() * basis;
  map.block<1, 2>(2, 0) = -arm.transpose() * basis;
  map(2, 2) = -1.0;
  return map * covariance * map.transpose();
}

}  // namespace s3lam
