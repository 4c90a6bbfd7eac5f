#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "s3lam/refine/bundle_solver.h"
#include "s3lam/refine/schur_layout.h"

namespace s3lam {

/// The values that a bundle adjustment changes.
struct BundleState {
  std::vector<PoseBlock> poses;
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector4d> planes;
  double height = 1.0;
  std::vector<std::vector<double>> camera_params;
};

/// The damped normal equations of a bundle problem,
///   [ B + D_c^2    W       ] [ dc ]     [ g_c ]
///   [ W^T          V + D_p^2 ] [ dp ] = - [ g_p ]
/// with the points' 3 x 3 blocks V + D_p^2 = L L^T eliminated:
///   (B + D_c^2 - U U^T) dc = -g_c + U L^-1 g_p,   U = W L^-T.
/// Robust losses act by weighting residual and Jacobian with sqrt(rho'). A point on a plane is one
/// residual, so its block of W is the outer product j n^T of the Jacobians by plane and point, and
/// costs a tenth of an observation. A camera has one block of W with each point that its images
/// see; in B it is tied to their poses.
///
/// Work on points runs in chunks that depend on the problem alone, work on the reduced system by
/// rows that have one owner, and partial sums are added in a fixed order: the numbers are the same
/// for any number of threads.
class NormalEquations {
 public:
  NormalEquations(const BundleSolverOptions& options, const BundleProblem& problem,
                  const std::vector<StructureTerm>& terms, const SchurLayout& layout);

  /// Fills the undamped system and returns the cost, 1/2 sum rho; infinity with a point behind a
  /// camera.
  double Linearize(const BundleState& state);

  /// Adds D^2 = diag(J^T J) / radius and eliminates the points; false if that is not possible.
  bool Damp(double radius);

  /// The reduced system of the last Damp.
  void FillReduced(BlockMatrix& matrix) const;
  [[nodiscard]] Eigen::VectorXd ReducedRightSide() const;
  /// The same matrix as a product, without forming it.
  [[nodiscard]] Eigen::VectorXd MultiplyReduced(const Eigen::VectorXd& x) const;
  /// The inverses of its diagonal blocks.
  [[nodiscard]] std::vector<Eigen::MatrixXd> InverseDiagonalBlocks() const;

  struct Step {
    double model_decrease = 0.0;  // Of the cost, by the linearised model.
    double squared_norm = 0.0;
    double squared_state_norm = 0.0;
    double cost = 0.0;  // Of the moved state; infinity with a point behind a camera.
  };
  /// Points' steps from the step of the others, both applied to `state`. `slack` is dc . (right
  /// side - matrix * dc): zero if the reduced system was solved exactly.
  Step Apply(const Eigen::VectorXd& step, double slack, const BundleState& state,
             BundleState& moved) const;

 private:
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Matrix26 = Eigen::Matrix<double, 2, 6>;
  using Matrix63 = Eigen::Matrix<double, 6, 3>;
  /// Rows: a camera's free parameters.
  template <int kCols>
  using CameraRows = Eigen::Matrix<double, Eigen::Dynamic, kCols, 0, kMaxCameraParams,
                                   kCols == Eigen::Dynamic ? kMaxCameraParams : kCols>;

  /// Sums of one chunk of points over poses and planes.
  struct Sums {
    std::vector<Matrix6> pose_hessian;
    std::vector<Vector6> pose_gradient;
    std::vector<Eigen::Matrix3d> plane_hessian;
    std::vector<Eigen::Vector3d> plane_gradient;
    std::vector<CameraRows<Eigen::Dynamic>> camera_hessian;
    std::vector<CameraRows<1>> camera_gradient;
    std::vector<CameraRows<6>> camera_by_pose;  // Per pose, of its camera; no cameras: empty.
    double cost = 0.0;
  };
  /// A term that touches no point, linearised: its Jacobian by the tangents of its variables.
  struct LinearTerm {
    std::vector<int> variables;  // Without constant ones.
    std::vector<Eigen::MatrixXd> jacobians;
    Eigen::VectorXd residual;
  };

  static std::vector<Eigen::Matrix3d> RotationMatrices(const std::vector<PoseBlock>& poses);
  /// Of all residuals that touch a point, were it at `point`.
  [[nodiscard]] double PointCost(size_t p, const Eigen::Vector3d& point,
                                 const std::vector<Eigen::Matrix3d>& rotations,
                                 const BundleState& state) const;
  double MovePoint(size_t p, const Eigen::Vector3d& change,
                   const std::vector<Eigen::Matrix3d>& rotations, BundleState& moved) const;
  [[nodiscard]] double StructureCost(const BundleState& state) const;
  void LinearizeStructure(const BundleState& state);
  [[nodiscard]] Sums ZeroSums() const;
  void LinearizeChunk(const BundleState& state, size_t chunk, Sums& sums);
  bool LinearizeObservation(const BundleState& state, size_t k, Sums& sums,
                            Eigen::Matrix3d& hessian, Eigen::Vector3d& gradient);
  [[nodiscard]] CameraRows<2> CameraJacobian(int camera, const BundleState& state,
                                             const Eigen::Vector3d& in_camera) const;
  void AddCamera(const BundleObservation& o, const CameraRows<2>& by_camera,
                 const Eigen::Vector2d& residual, const Eigen::Matrix<double, 2, 3>& by_point,
                 const Matrix26& by_pose, Sums& sums);
  void LinearizePlaneTerm(const BundleState& state, size_t k, Sums& sums, Eigen::Matrix3d& hessian,
                          Eigen::Vector3d& gradient);
  void HoldPoint(size_t point);
  void AddSums(const std::vector<Sums>& sums);
  void HoldScale(const BundleState& state);
  [[nodiscard]] int CameraVariable(int pose) const {
    return layout_.variable_of_camera[problem_.camera_of_pose[pose]];
  }
  bool DampPoint(size_t point, double radius);
  void FillPoseRow(int i, const std::vector<int>& place, BlockMatrix& matrix) const;
  void FillPlaneRow(int i, const std::vector<int>& place, BlockMatrix& matrix) const;
  void FillCameraRow(int i, const std::vector<int>& place, BlockMatrix& matrix) const;
  [[nodiscard]] Eigen::Vector3d TimesTransposed(size_t point, const Eigen::VectorXd& x) const;
  void MoveStructure(const Eigen::VectorXd& step, const BundleState& state,
                     BundleState& moved) const;
  [[nodiscard]] Eigen::MatrixXd DampedBlock(int i) const;
  /// Calls body(first, last) for stretches of variables, in parallel.
  void ForRows(const std::function<void(int, int)>& body) const;

  const BundleSolverOptions& options_;
  const BundleProblem& problem_;
  const std::vector<StructureTerm>& terms_;
  const SchurLayout& layout_;

  std::vector<Eigen::Matrix3d> rotations_;
  std::vector<Eigen::Matrix<double, 3, 2>> tangents_;  // Per plane: of its normal.
  std::vector<Matrix63> u_;                            // Per observation: W, after Damp U = W L^-T.
  std::vector<Eigen::Vector3d> normal_;            // Per point on a plane: n, after Damp L^-1 n.
  std::vector<Eigen::Vector3d> by_plane_;          // Per point on a plane: j.
  std::vector<CameraRows<3>> seen_;                // Per point in a camera: W, after Damp U.
  std::vector<double> cost_;                       // Per point: of its residuals.
  std::vector<Eigen::Matrix3d> hessian_;           // Per point: V.
  std::vector<Eigen::Matrix3d> factor_;            // Per point: L, the identity before Damp.
  std::vector<Eigen::Vector3d> gradient_;          // Per point: g_p.
  std::vector<Eigen::Vector3d> reduced_gradient_;  // Per point: L^-1 g_p.
  Eigen::VectorXd gradient_c_;
  std::vector<Matrix6> pose_hessian_;
  std::vector<Eigen::Matrix3d> plane_hessian_;
  std::vector<CameraRows<Eigen::Dynamic>> camera_hessian_;
  std::vector<CameraRows<6>> camera_by_pose_;  // Per pose; no cameras: empty.
  std::vector<LinearTerm> linear_terms_;
  Eigen::VectorXd diagonal_;  // Of B, whole.
  Eigen::VectorXd damping_;   // D_c^2.
  double radius_ = 1.0;
  Vector6 held_direction_ = Vector6::Zero();  // Of the pose whose distance is held; unit.
};

}  // namespace s3lam
