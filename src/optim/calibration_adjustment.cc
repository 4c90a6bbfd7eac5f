#include "calibration_adjustment.h"

#include <ceres/rotation.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

constexpr int kMaxParams = 12;
constexpr double kHuberSigma = 2.4477;      // sqrt(5.991)
constexpr double kGaugeDamping = 1e-9;      // Of the diagonal.
constexpr double kPrincipalSigma = 0.02;    // Of the longer side, from the centre.
constexpr int kMinObservationsOfPose = 50;  // If it has as many.
constexpr double kDistortionSigma = 0.3;    // Of wide lenses' first radial term.

/// r = inverse_sigma (project(exp(omega) R X + t) - pixel), with R the pose's rotation at the
/// start.
struct ReprojectionError {
  CameraModel model;
  Eigen::Matrix3d rotation;
  Eigen::Vector2d pixel;
  double inverse_sigma;

  template <typename T>
  bool operator()(const T* pose, const T* point, const T* params, T* residual) const {
    const Eigen::Matrix<T, 3, 1> rotated =
        rotation.cast<T>() * Eigen::Map<const Eigen::Matrix<T, 3, 1>>(point);
    std::array<T, 3> x;
    ceres::AngleAxisRotatePoint(pose, rotated.data(), x.data());
    for (size_t i = 0; i < 3; ++i) x[i] += pose[3 + i];
    if (x[2] <= T(1e-6)) return false;  // Rejects the step: nothing starts behind a camera.
    std::array<T, 2> projected;
    ImageFromCamera(model, params, x.data(), projected.data());
    residual[0] = T(inverse_sigma) * (projected[0] - T(pixel.x()));
    residual[1] = T(inverse_sigma) * (projected[1] - T(pixel.y()));
    return true;
  }
};

/// The same with the camera held, and what a readout time adds.
struct ReadoutError {
  ReprojectionError reprojection;
  std::array<double, kMaxParams> params;
  Eigen::Vector2d per_readout;

  template <typename T>
  bool operator()(const T* pose, const T* point, const T* readout, T* residual) const {
    std::array<T, kMaxParams> camera;
    for (size_t i = 0; i < camera.size(); ++i) camera[i] = T(params[i]);
    if (!reprojection(pose, point, camera.data(), residual)) return false;
    for (int i = 0; i < 2; ++i) {
      residual[i] += readout[0] * T(reprojection.inverse_sigma * per_readout[i]);
    }
    return true;
  }
};

/// Points with the longest tracks, of a least length, until there are enough observations, and more
/// of them for poses that have few of those: where a camera stands still, tracks are long and say
/// little. True per chosen point.
std::vector<uint8_t> ChoosePoints(const CalibrationProblem& problem, int max_observations,
                                  int min_length) {
  std::vector<std::vector<int>> poses_of_point(problem.points.size());
  for (const auto& o : problem.observations) poses_of_point[o.point].push_back(o.pose);
  std::vector<int> order(problem.points.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return poses_of_point[a].size() > poses_of_point[b].size();
  });
  std::vector<int> chosen_of_pose(problem.poses.size(), 0);
  std::vector<uint8_t> chosen(problem.points.size(), 0);
  int count = 0;
  for (const int point : order) {
    const std::vector<int>& poses = poses_of_point[point];
    if (static_cast<int>(poses.size()) < min_length) break;
    const bool needed =
        count < max_observations || std::any_of(poses.begin(), poses.end(), [&](int pose) {
          return chosen_of_pose[pose] < kMinObservationsOfPose;
        });
    if (!needed) continue;
    chosen[point] = 1;
    count += static_cast<int>(poses.size());
    for (const int pose : poses) ++chosen_of_pose[pose];
  }
  return chosen;
}

/// r = (value - expected) / sigma: the logarithm of the focal length, the first radial term against
/// zero, the principal point against the centre of the image.
struct CameraPrior {
  FocalPrior focal;
  Eigen::Vector2d principal;  // px
  double principal_sigma;     // px

  template <typename T>
  bool operator()(const T* params, T* residual) const {
    using std::log;
    if (params[0] <= T(0.0)) return false;
    residual[0] = (log(params[0]) - T(std::log(focal.focal))) / T(focal.relative_sigma);
    residual[1] = params[3] / T(kDistortionSigma);
    residual[2] = (params[1] - T(principal.x())) / T(principal_sigma);
    residual[3] = (params[2] - T(principal.y())) / T(principal_sigma);
    return true;
  }
};

}  // namespace

CalibrationAdjustment::CalibrationAdjustment(const SelfCalibrationOptions& options,
                                             const Camera& camera, const CalibrationProblem& input,
                                             int min_length, Shared shared)
    : options_(options),
      shared_(shared),
      camera_(camera),
      points_(input.points),
      poses_(input.poses.size()),
      loss_(kHuberSigma) {
  for (size_t i = 0; i < poses_.size(); ++i) {
    const Eigen::Vector3d& t = input.poses[i].translation;
    poses_[i] = {0.0, 0.0, 0.0, t.x(), t.y(), t.z()};
  }
  const std::vector<uint8_t> chosen = ChoosePoints(input, options.max_observations, min_length);
  for (const auto& o : input.observations) {
    const Rigid3& pose = input.poses[o.pose];
    if (chosen[o.point] == 0 || (pose * input.points[o.point]).z() <= 1e-6) continue;
    problem_.AddResidualBlock(MakeCost(o, pose), &loss_, poses_[o.pose].data(),
                              points_[o.point].data(), SharedParams());
  }
}

std::optional<double> CalibrationAdjustment::SigmaOfFirstParam() {
  ceres::Problem::EvaluateOptions evaluate;
  for (Eigen::Vector3d& point : points_) {
    if (problem_.HasParameterBlock(point.data())) evaluate.parameter_blocks.push_back(point.data());
  }
  for (auto& pose : poses_) {
    if (problem_.HasParameterBlock(pose.data())) evaluate.parameter_blocks.push_back(pose.data());
  }
  evaluate.parameter_blocks.push_back(SharedParams());
  ceres::CRSMatrix crs;
  if (!problem_.Evaluate(evaluate, nullptr, nullptr, nullptr, &crs)) return std::nullopt;
  using Sparse = Eigen::SparseMatrix<double>;
  const Sparse jacobian = Eigen::Map<const Eigen::SparseMatrix<double, Eigen::RowMajor>>(
      crs.num_rows, crs.num_cols, static_cast<Eigen::Index>(crs.values.size()), crs.rows.data(),
      crs.cols.data(), crs.values.data());
  Sparse normal = jacobian.transpose() * jacobian;
  // Position, orientation and scale of the world are free, and nothing else depends on them.
  const Eigen::VectorXd diagonal = normal.diagonal();
  for (int i = 0; i < crs.num_cols; ++i) normal.coeffRef(i, i) += kGaugeDamping * diagonal[i];
  const Eigen::SimplicialLDLT<Sparse> factor(normal);
  if (factor.info() != Eigen::Success) return std::nullopt;
  const int first = crs.num_cols - problem_.ParameterBlockTangentSize(SharedParams());
  Eigen::VectorXd unit = Eigen::VectorXd::Zero(crs.num_cols);
  unit[first] = 1.0;
  const double variance = factor.solve(unit)[first];
  return std::isfinite(variance) && variance > 0.0 ? std::optional(std::sqrt(variance))
                                                   : std::nullopt;
}

double CalibrationAdjustment::MeanScore() {
  ceres::Problem::EvaluateOptions evaluate;
  evaluate.apply_loss_function = false;
  std::vector<double> residuals;
  if (!problem_.Evaluate(evaluate, nullptr, &residuals, nullptr, nullptr)) return 0.0;
  double score = 0.0;
  const size_t count = residuals.size() / 2;  // Two each; those of the prior do not weigh.
  for (size_t i = 0; i < 2 * count; i += 2) {
    const double squared = residuals[i] * residuals[i] + residuals[i + 1] * residuals[i + 1];
    score += std::max(0.0, 1.0 - squared / (kHuberSigma * kHuberSigma));
  }
  return score / static_cast<double>(count);
}

std::vector<Rigid3> CalibrationAdjustment::Poses(const std::vector<Rigid3>& start) const {
  std::vector<Rigid3> poses(poses_.size());
  for (size_t i = 0; i < poses_.size(); ++i) {
    const Eigen::Map<const Eigen::Vector3d> turn(poses_[i].data());
    const Eigen::Quaterniond rotation(Eigen::AngleAxisd(
        turn.norm(), turn.norm() > 0.0 ? Eigen::Vector3d(turn.normalized())
                                       : Eigen::Vector3d(Eigen::Vector3d::UnitX())));
    poses[i].rotation = (rotation * start[i].rotation).normalized();
    poses[i].translation = Eigen::Map<const Eigen::Vector3d>(poses_[i].data() + 3);
  }
  return poses;
}

void CalibrationAdjustment::FreeReadout(bool is_free) {
  if (is_free) return problem_.SetParameterBlockVariable(&readout_);
  problem_.SetParameterBlockConstant(&readout_);
}

void CalibrationAdjustment::FreeCamera(const std::vector<int>& free_params) {
  double* params = camera_.params.data();
  if (free_params.empty()) {
    if (FirstPose() != nullptr) problem_.SetParameterBlockConstant(FirstPose());
    problem_.SetParameterBlockConstant(params);
    return;
  }
  problem_.SetParameterBlockVariable(params);
  if (free_params.size() == camera_.params.size()) return problem_.SetManifold(params, nullptr);
  std::vector<int> held;
  for (int i = 0; i < static_cast<int>(camera_.params.size()); ++i) {
    if (std::find(free_params.begin(), free_params.end(), i) == free_params.end()) {
      held.push_back(i);
    }
  }
  problem_.SetManifold(params,
                       new ceres::SubsetManifold(static_cast<int>(camera_.params.size()), held));
}

void CalibrationAdjustment::AddPrior(const FocalPrior& prior) {
  auto* error = new CameraPrior{prior, 0.5 * Eigen::Vector2d(camera_.width, camera_.height),
                                kPrincipalSigma * std::max(camera_.width, camera_.height)};
  double* params = camera_.params.data();
  if (camera_.params.size() == 4) {
    problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<CameraPrior, 4, 4>(error), nullptr,
                              params);
  } else {
    problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<CameraPrior, 4, 5>(error), nullptr,
                              params);
  }
}

std::optional<CalibrationAdjustment::Solution> CalibrationAdjustment::Solve() {
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_SCHUR;
  if (poses_.size() > 250) solver.linear_solver_type = ceres::SPARSE_SCHUR;
  solver.max_num_iterations = options_.max_iterations;
  solver.function_tolerance = 1e-5;
  solver.num_threads = 1;  // The same bytes every time.
  solver.logging_type = ceres::SILENT;
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (Eigen::Vector3d& point : points_) {
    if (problem_.HasParameterBlock(point.data())) ordering->AddElementToGroup(point.data(), 0);
  }
  for (auto& pose : poses_) {
    if (problem_.HasParameterBlock(pose.data())) ordering->AddElementToGroup(pose.data(), 1);
  }
  // Ceres orders the blocks of a group by their addresses, of which only those of one vector are
  // in the same order every time.
  ordering->AddElementToGroup(SharedParams(), 2);
  solver.linear_solver_ordering = ordering;
  std::string error;
  S3LAM_CHECK_MSG(solver.IsValid(&error), "{}", error);
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem_, &summary);
  if (!summary.IsSolutionUsable()) return std::nullopt;
  return Solution{summary.final_cost, summary.termination_type == ceres::CONVERGENCE};
}

ceres::CostFunction* CalibrationAdjustment::MakeCost(const CalibrationProblem::Observation& o,
                                                     const Rigid3& pose) const {
  const ReprojectionError reprojection{camera_.model, pose.rotation.toRotationMatrix(), o.pixel,
                                       o.inverse_sigma};
  if (shared_ == Shared::kReadout) {
    auto* error = new ReadoutError{reprojection, {}, o.per_readout};
    std::copy(camera_.params.begin(), camera_.params.end(), error->params.begin());
    return new ceres::AutoDiffCostFunction<ReadoutError, 2, 6, 3, 1>(error);
  }
  auto* error = new ReprojectionError(reprojection);
  switch (camera_.params.size()) {
    case 4:
      return new ceres::AutoDiffCostFunction<ReprojectionError, 2, 6, 3, 4>(error);
    case 5:
      return new ceres::AutoDiffCostFunction<ReprojectionError, 2, 6, 3, 5>(error);
    case 8:
      return new ceres::AutoDiffCostFunction<ReprojectionError, 2, 6, 3, 8>(error);
    default:
      return new ceres::AutoDiffCostFunction<ReprojectionError, 2, 6, 3, kMaxParams>(error);
  }
}

double* CalibrationAdjustment::FirstPose() {
  for (auto& pose : poses_) {
    if (problem_.HasParameterBlock(pose.data())) return pose.data();
  }
  return nullptr;
}

double* CalibrationAdjustment::SharedParams() {
  return shared_ == Shared::kCamera ? camera_.params.data() : &readout_;
}

}  // namespace s3lam
