#include "s3lam/refine/bundle_solver.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <deque>
#include <stdexcept>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/refine/cost_functions.h"
#include "s3lam/refine/exact_plane_cost.h"
#include "s3lam/refine/schur_bundle.h"
#include "s3lam/refine/structure_terms.h"

namespace s3lam {
namespace {

constexpr std::array<std::string_view, 3> kBackendNames{"auto", "schur", "ceres"};
constexpr std::array<std::string_view, 4> kLinearSolverNames{"auto", "dense", "sparse",
                                                             "iterative"};
/// Rows of the reduced system up to which it is factored densely, and from which it is solved by
/// iteration: orders of magnitude from the cost of dense algebra, not measured on large maps.
constexpr int kMaxDenseRows = 2000;
constexpr int kMaxSparseRows = 60000;
/// Little damping: the gauge is held, and a map's weak modes (bend, drift of scale) need long
/// steps.
constexpr double kInitialTrustRegion = 1e6;
/// Steps refused in a row, e.g. because a point would go behind its camera, before giving up.
constexpr int kMaxRefusedSteps = 20;

class CeresBundle {
 public:
  CeresBundle(const BundleSolverOptions& options, BundleProblem& bundle)
      : options_(options),
        bundle_(bundle),
        reprojection_loss_(options.huber_reprojection),
        plane_loss_(options.huber_plane),
        point_blocks_(bundle.points),
        problem_(ProblemOptions()) {
    PutPointsOnPlanes();
    AddObservations();
    AddPlanes();
    AddStructure();
    FreeCameras();
    HoldPoints();
    HoldGauge();
  }

  BundleSolverReport Solve() {
    ceres::Solver::Options solver_options = SolverOptions();
    std::string error;
    if (!solver_options.IsValid(&error)) {
      throw std::runtime_error("the bundle adjustment's options are refused: " + error);
    }
    ceres::Solver::Summary summary;
    ceres::Solve(solver_options, &problem_, &summary);
    if (!summary.IsSolutionUsable() || !std::isfinite(summary.final_cost)) {
      throw std::runtime_error("the bundle adjustment failed: " + summary.message);
    }
    StorePoints();
    BundleSolverReport report;
    report.initial_cost = summary.initial_cost;
    report.final_cost = summary.final_cost;
    report.num_iterations = static_cast<int>(summary.iterations.size()) - 1;
    report.converged = summary.termination_type == ceres::CONVERGENCE;
    report.linear_solver = ceres::LinearSolverTypeToString(summary.linear_solver_type_used);
    report.message = summary.message;
    return report;
  }

  double Cost() {
    double cost = 0.0;
    ceres::Problem::EvaluateOptions evaluate;
    if (!problem_.Evaluate(evaluate, &cost, nullptr, nullptr, nullptr)) {
      return std::numeric_limits<double>::infinity();
    }
    return cost;
  }

  BundleLinearization Linearize() {
    BundleLinearization linear;
    ceres::Problem::EvaluateOptions evaluate;
    int columns = 0;
    const auto add = [&](double* block) {
      if (!problem_.HasParameterBlock(block) || problem_.IsParameterBlockConstant(block)) return -1;
      evaluate.parameter_blocks.push_back(block);
      const int first = columns;
      columns += problem_.ParameterBlockTangentSize(block);
      return first;
    };
    linear.full_from_pose.resize(bundle_.poses.size());
    for (size_t i = 0; i < bundle_.poses.size(); ++i) {
      double* pose = Pose(static_cast<int>(i));
      linear.pose_columns.push_back(add(pose));
      if (linear.pose_columns.back() < 0) continue;
      Eigen::Matrix<double, 7, Eigen::Dynamic, Eigen::RowMajor> plus(
          7, problem_.ParameterBlockTangentSize(pose));
      problem_.GetManifold(pose)->PlusJacobian(pose, plus.data());
      linear.full_from_pose[i] = ComputePoseMinusJacobian(pose) * plus;
    }
    for (AnchoredPlane& plane : bundle_.planes) {
      linear.plane_columns.push_back(add(plane.parameters.data()));
    }
    add(&bundle_.height);
    for (Camera& camera : bundle_.cameras) add(camera.params.data());
    linear.num_other_columns = columns;
    for (Eigen::Vector3d& block : point_blocks_) {
      const int column = add(block.data());
      if (column >= 0) linear.point_columns.push_back(column);
    }
    ceres::CRSMatrix rows;
    if (!problem_.Evaluate(evaluate, nullptr, nullptr, nullptr, &rows)) {
      throw std::runtime_error("the bundle cannot be linearised: a point is behind its camera");
    }
    linear.jacobian = Eigen::Map<const Eigen::SparseMatrix<double, Eigen::RowMajor>>(
        rows.num_rows, rows.num_cols, static_cast<Eigen::Index>(rows.values.size()),
        rows.rows.data(), rows.cols.data(), rows.values.data());
    return linear;
  }

 private:
  static ceres::Problem::Options ProblemOptions() {
    ceres::Problem::Options options;
    options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }

  void AddObservations() {
    for (const BundleObservation& o : bundle_.observations) {
      Camera& camera = CameraOfPose(o.pose);
      const double sigma_px = options_.sigma_px * o.sigma;
      if (const int plane = ExactPlane(o.point); plane >= 0) {
        exact_reprojections_.emplace_back(camera.model, o.pixel, sigma_px, frames_[plane]);
        problem_.AddResidualBlock(&exact_reprojections_.back(), &reprojection_loss_, Pose(o.pose),
                                  PointBlock(o.point), UsePlane(plane), camera.params.data());
      } else {
        reprojections_.emplace_back(camera.model, o.pixel, sigma_px);
        problem_.AddResidualBlock(&reprojections_.back(), &reprojection_loss_, Pose(o.pose),
                                  PointBlock(o.point), camera.params.data());
      }
      problem_.SetParameterBlockConstant(camera.params.data());
    }
    used_poses_ = bundle_.UsedPoses();
    for (int i = 0; i < static_cast<int>(used_poses_.size()); ++i) {
      if (used_poses_[i] == 0) continue;
      problem_.SetManifold(Pose(i), &pose_manifold_);
      if (bundle_.pose_is_constant[i] != 0) problem_.SetParameterBlockConstant(Pose(i));
    }
  }

  /// Points that lie exactly on a plane are two coordinates in it from here on.
  void PutPointsOnPlanes() {
    for (const PointOnPlane& term : bundle_.points_on_planes) {
      if (!term.is_exact) continue;
      if (exact_plane_.empty()) {
        exact_plane_.assign(bundle_.points.size(), -1);
        for (const AnchoredPlane& plane : bundle_.planes) frames_.push_back(PlaneFrame::Of(plane));
      }
      exact_plane_[term.point] = term.plane;
      point_blocks_[term.point].head<2>() =
          frames_[term.plane].Coordinates(bundle_.points[term.point]);
    }
  }

  /// Their places in the world, after a solve.
  void StorePoints() {
    for (size_t j = 0; j < point_blocks_.size(); ++j) {
      const int plane = ExactPlane(static_cast<int>(j));
      if (plane < 0) {
        bundle_.points[j] = point_blocks_[j];
        continue;
      }
      Eigen::Vector3d point;
      if (PointInPlane(frames_[plane], bundle_.planes[plane].parameters.data(),
                       point_blocks_[j].data(), &point)) {
        bundle_.points[j] = point;
      }
    }
  }

  [[nodiscard]] int ExactPlane(int point) const {
    return exact_plane_.empty() ? -1 : exact_plane_[point];
  }

  void AddPlanes() {
    if (bundle_.points_on_planes.empty()) return;
    for (const PointOnPlane& term : bundle_.points_on_planes) {
      double* point = PointBlock(term.point);
      if (term.is_exact || !problem_.HasParameterBlock(point)) continue;
      AnchoredPlane& plane = bundle_.planes[term.plane];
      if (plane.is_constant) {
        const Plane fixed = plane.PlaneInWorld();
        Eigen::Vector4d coefficients;
        coefficients << fixed.normal, fixed.offset;
        fixed_planes_.emplace_back(coefficients, term.sigma);
        problem_.AddResidualBlock(&fixed_planes_.back(), &plane_loss_, point);
      } else {
        point_planes_.emplace_back(plane.anchor_in_world, term.sigma);
        problem_.AddResidualBlock(&point_planes_.back(), &plane_loss_, point, UsePlane(term.plane));
      }
    }
  }

  /// Relations between planes, heights of cameras, pose priors.
  void AddStructure() {
    structure_ = MakeStructureTerms(bundle_, used_poses_);
    for (const StructureTerm& term : structure_) {
      std::vector<double*> blocks;
      for (const StructureBlock& block : term.blocks) blocks.push_back(Block(block));
      problem_.AddResidualBlock(term.cost.get(), LossOf(term), blocks);
    }
  }

  ceres::LossFunction* LossOf(const StructureTerm& term) {
    if (term.loss == StructureTerm::Loss::kNone) return nullptr;
    return term.loss == StructureTerm::Loss::kPlane ? &plane_loss_ : &reprojection_loss_;
  }

  double* Block(const StructureBlock& block) {
    switch (block.kind) {
      case StructureBlock::Kind::kPose:
        return Pose(block.index);
      case StructureBlock::Kind::kPlane:
        return UsePlane(block.index);
      case StructureBlock::Kind::kHeight:
        break;
    }
    return &bundle_.height;
  }

  /// Camera parameters are constant but for those asked for.
  void FreeCameras() {
    for (size_t c = 0; c < bundle_.free_camera_params.size(); ++c) {
      const std::vector<int>& free = bundle_.free_camera_params[c];
      std::vector<double>& params = bundle_.cameras[c].params;
      if (free.empty() || !problem_.HasParameterBlock(params.data())) continue;
      problem_.SetParameterBlockVariable(params.data());
      std::vector<int> held;
      for (int i = 0; i < static_cast<int>(params.size()); ++i) {
        if (std::find(free.begin(), free.end(), i) == free.end()) held.push_back(i);
      }
      if (held.empty()) continue;
      camera_manifolds_.push_back(
          std::make_unique<ceres::SubsetManifold>(static_cast<int>(params.size()), held));
      problem_.SetManifold(params.data(), camera_manifolds_.back().get());
    }
  }

  void HoldPoints() {
    for (size_t j = 0; j < bundle_.point_is_constant.size(); ++j) {
      double* point = PointBlock(static_cast<int>(j));
      if (bundle_.point_is_constant[j] != 0 && problem_.HasParameterBlock(point)) {
        problem_.SetParameterBlockConstant(point);
      }
    }
  }

  double* UsePlane(int index) {
    double* block = bundle_.planes[index].parameters.data();
    if (!problem_.HasParameterBlock(block)) {
      problem_.AddParameterBlock(block, 4, &plane_manifold_);
      if (bundle_.planes[index].is_constant) problem_.SetParameterBlockConstant(block);
    }
    return block;
  }

  void HoldGauge() {
    const Gauge& gauge = bundle_.gauge;
    if (gauge.fixed_pose < 0 || used_poses_[gauge.fixed_pose] == 0) return;
    problem_.SetParameterBlockConstant(Pose(gauge.fixed_pose));
    if (gauge.scale_pose < 0 || used_poses_[gauge.scale_pose] == 0) return;
    scale_manifold_ =
        std::make_unique<HeldDistancePoseManifold>(bundle_.CenterOf(gauge.fixed_pose));
    problem_.SetManifold(Pose(gauge.scale_pose), scale_manifold_.get());
  }

  [[nodiscard]] ceres::LinearSolverType ChooseLinearSolver() const {
    switch (options_.linear_solver) {
      case LinearSolver::kDenseSchur:
        return ceres::DENSE_SCHUR;
      case LinearSolver::kSparseSchur:
        return ceres::SPARSE_SCHUR;
      case LinearSolver::kIterativeSchur:
        return ceres::ITERATIVE_SCHUR;
      case LinearSolver::kAuto:
        break;
    }
    const auto rows = 6 * std::count(used_poses_.begin(), used_poses_.end(), 1);
    if (rows <= kMaxDenseRows) return ceres::DENSE_SCHUR;
    return rows <= kMaxSparseRows ? ceres::SPARSE_SCHUR : ceres::ITERATIVE_SCHUR;
  }

  ceres::Solver::Options SolverOptions() {
    ceres::Solver::Options options;
    options.linear_solver_type = ChooseLinearSolver();
    if (options.linear_solver_type == ceres::ITERATIVE_SCHUR) {
      options.preconditioner_type = ceres::SCHUR_JACOBI;
    }
    options.num_threads = 1;
    options.max_num_iterations = options_.max_iterations;
    options.function_tolerance = options_.function_tolerance;
    options.gradient_tolerance = 0.0;
    options.initial_trust_region_radius = kInitialTrustRegion;
    options.parameter_tolerance = 1e-10;
    options.max_num_consecutive_invalid_steps = kMaxRefusedSteps;
    options.logging_type = ceres::SILENT;
    options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    AddOrdering(*options.linear_solver_ordering);
    return options;
  }

  /// Points are eliminated first. Ceres orders the blocks of a group by their addresses, of which
  /// only those of one vector are in the same order every time: every vector is a group.
  void AddOrdering(ceres::ParameterBlockOrdering& ordering) {
    int group = 0;
    const auto add = [&](double* block) {
      if (problem_.HasParameterBlock(block)) ordering.AddElementToGroup(block, group);
    };
    for (Eigen::Vector3d& block : point_blocks_) add(block.data());
    ++group;
    for (PoseBlock& pose : bundle_.poses) add(pose.data());
    ++group;
    for (AnchoredPlane& plane : bundle_.planes) add(plane.parameters.data());
    ++group;
    add(&bundle_.height);
    for (Camera& camera : bundle_.cameras) {
      ++group;
      add(camera.params.data());
    }
  }

  double* PointBlock(int index) { return point_blocks_[index].data(); }
  double* Pose(int index) { return bundle_.poses[index].data(); }
  Camera& CameraOfPose(int index) { return bundle_.cameras[bundle_.camera_of_pose[index]]; }

  const BundleSolverOptions& options_;
  BundleProblem& bundle_;
  ceres::HuberLoss reprojection_loss_;
  ceres::HuberLoss plane_loss_;
  PoseManifold pose_manifold_;
  AnchoredPlaneManifold plane_manifold_;
  std::unique_ptr<HeldDistancePoseManifold> scale_manifold_;
  std::vector<std::unique_ptr<ceres::SubsetManifold>> camera_manifolds_;
  std::deque<ReprojectionCost> reprojections_;
  std::deque<ExactPlaneReprojectionCost> exact_reprojections_;
  /// Per point: its place, or, where it lies exactly on a plane, two coordinates in that.
  std::vector<Eigen::Vector3d> point_blocks_;
  std::vector<int> exact_plane_;    // Per point: the plane it is on; empty: none is.
  std::vector<PlaneFrame> frames_;  // Per plane.
  std::deque<PointFixedPlaneCost> fixed_planes_;
  std::deque<PointPlaneCost> point_planes_;
  std::vector<StructureTerm> structure_;
  std::vector<uint8_t> used_poses_;
  ceres::Problem problem_;  // Last: it refers to all of the above.
};

}  // namespace

void BundleSolverOptions::Visit(OptionVisitor& v) {
  v.Value("huber_reprojection", huber_reprojection,
          "Huber's threshold of reprojection residuals [sigma]", 1e-6, 1e6);
  v.Value("huber_plane", huber_plane, "Huber's threshold of all plane residuals [sigma]", 1e-6,
          1e6);
  v.Value("max_iterations", max_iterations, "most Levenberg-Marquardt iterations per solve", 1,
          100000);
  v.Value("function_tolerance", function_tolerance,
          "a solve ends when the cost falls by less than this part of it", 0.0, 1.0);
  v.Choice("linear_solver", linear_solver, kLinearSolverNames,
           "how the reduced camera system is solved; auto goes by its size");
  v.Choice("backend", backend, kBackendNames,
           "schur: the project's own solver, on all threads; ceres: Ceres on one thread; auto: "
           "schur for all it can do");
}

BundleSolverReport SolveBundle(const BundleSolverOptions& options, BundleProblem& problem) {
  S3LAM_CHECK(problem.poses.size() == problem.camera_of_pose.size());
  S3LAM_CHECK(problem.poses.size() == problem.pose_is_constant.size());
  if (problem.observations.empty()) {
    BundleSolverReport report;
    report.converged = true;
    report.message = "no observations";
    return report;
  }
  if (options.backend == SolverBackend::kSchur ||
      (options.backend == SolverBackend::kAuto && CanSolveBySchur(problem))) {
    return SolveBundleBySchur(options, problem);
  }
  return CeresBundle(options, problem).Solve();
}

BundleLinearization LinearizeBundle(const BundleSolverOptions& options,
                                    const BundleProblem& problem) {
  BundleProblem copy = problem;
  return CeresBundle(options, copy).Linearize();
}

double BundleCost(const BundleSolverOptions& options, const BundleProblem& problem) {
  BundleProblem copy = problem;
  return copy.observations.empty() ? 0.0 : CeresBundle(options, copy).Cost();
}

}  // namespace s3lam
