#include "s3lam/optim/self_calibration.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <fmt/format.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

constexpr int kMaxParams = 12;
constexpr double kHuberSigma = 2.4477;      // sqrt(5.991)
constexpr double kGaugeDamping = 1e-9;      // Of the diagonal.
constexpr double kPrincipalSigma = 0.02;    // Of the longer side, from the centre.
constexpr int kMinObservationsOfPose = 50;  // If it has as many.
constexpr int kNumParts = 5;                // Whose focal lengths are compared.
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

/// Of all poses and points, and of what all observations have in common: the camera, or the readout
/// time of its shutter.
class Adjustment {
 public:
  enum class Shared { kCamera, kReadout };
  Adjustment(const SelfCalibrationOptions& options, const Camera& camera,
             const CalibrationProblem& input, int min_length, Shared shared = Shared::kCamera)
      : options_(options),
        shared_(shared),
        camera_(camera),
        points_(input.points),
        poses_(input.poses.size()) {
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

  /// Sigma of the first shared parameter over all others, which are free as well; empty if the
  /// normal equations cannot be solved.
  std::optional<double> SigmaOfFirstParam() {
    ceres::Problem::EvaluateOptions evaluate;
    for (Eigen::Vector3d& point : points_) {
      if (problem_.HasParameterBlock(point.data()))
        evaluate.parameter_blocks.push_back(point.data());
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

  /// See CameraRefinement.
  [[nodiscard]] double MeanScore() {
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

  [[nodiscard]] std::vector<Rigid3> Poses(const std::vector<Rigid3>& start) const {
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
  [[nodiscard]] const std::vector<Eigen::Vector3d>& points() const { return points_; }

  [[nodiscard]] bool empty() const { return problem_.NumResidualBlocks() == 0; }
  [[nodiscard]] const Camera& camera() const { return camera_; }
  [[nodiscard]] double readout() const { return readout_; }
  void FreeReadout(bool is_free) {
    if (is_free) return problem_.SetParameterBlockVariable(&readout_);
    problem_.SetParameterBlockConstant(&readout_);
  }

  /// Lets only these parameters of the camera vary; none: holds it and, for the gauge, the first
  /// pose.
  void FreeCamera(const std::vector<int>& free_params) {
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

  void AddPrior(const FocalPrior& prior) {
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

  struct Solution {
    double cost = 0.0;
    bool converged = false;
  };
  /// Empty if there is no usable solution.
  std::optional<Solution> Solve() {
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

 private:
  [[nodiscard]] ceres::CostFunction* MakeCost(const CalibrationProblem::Observation& o,
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

  [[nodiscard]] double* FirstPose() {
    for (auto& pose : poses_) {
      if (problem_.HasParameterBlock(pose.data())) return pose.data();
    }
    return nullptr;
  }

  [[nodiscard]] double* SharedParams() {
    return shared_ == Shared::kCamera ? camera_.params.data() : &readout_;
  }

  const SelfCalibrationOptions& options_;
  Shared shared_;
  Camera camera_;
  double readout_ = 0.0;  // [s]
  std::vector<Eigen::Vector3d> points_;
  std::vector<std::array<double, 6>> poses_;
  static ceres::Problem::Options BorrowingLoss() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }
  ceres::HuberLoss loss_{kHuberSigma};  // Of the adjustment, even if nothing is observed.
  ceres::Problem problem_{BorrowingLoss()};
};

/// What the poses [begin, end) saw.
CalibrationProblem PartOf(const CalibrationProblem& problem, int begin, int end) {
  CalibrationProblem part;
  part.poses.assign(problem.poses.begin() + begin, problem.poses.begin() + end);
  std::vector<int> times_seen(problem.points.size(), 0);
  const auto is_inside = [&](const auto& o) { return o.pose >= begin && o.pose < end; };
  for (const auto& o : problem.observations) times_seen[o.point] += is_inside(o) ? 1 : 0;
  std::vector<int> index(problem.points.size(), -1);
  for (size_t i = 0; i < index.size(); ++i) {
    if (times_seen[i] < 2) continue;
    index[i] = static_cast<int>(part.points.size());
    part.points.push_back(problem.points[i]);
  }
  for (auto o : problem.observations) {
    if (!is_inside(o) || index[o.point] < 0) continue;
    o.pose -= begin;
    o.point = index[o.point];
    part.observations.push_back(o);
  }
  return part;
}

}  // namespace

void SelfCalibrationOptions::Visit(OptionVisitor& v) {
  v.Value("enabled", enabled,
          "check whether the calibration explains the images, and refine the lens distortion");
  v.Value("min_cost_decrease", min_cost_decrease,
          "share of the reprojection cost that a refined distortion must remove to be accepted",
          0.0, 1.0);
  v.Value(
      "max_observations", max_observations,
      "observations used, longest tracks first; more where a keyframe has fewer than 50 of them",
      100, 100000000);
  v.Value("max_iterations", max_iterations, "of each solve", 1, 1000);
}

Camera WithDistortion(const Camera& camera) {
  const bool simple =
      camera.model == CameraModel::kSimplePinhole || camera.model == CameraModel::kPinhole ||
      camera.model == CameraModel::kSimpleRadial || camera.model == CameraModel::kRadial;
  if (!simple) return camera;
  Camera result = camera;
  result.model = CameraModel::kOpenCv;
  result.params = {camera.FocalX(),
                   camera.FocalY(),
                   camera.PrincipalX(),
                   camera.PrincipalY(),
                   0.0,
                   0.0,
                   0.0,
                   0.0};
  if (camera.model == CameraModel::kSimpleRadial) result.params[4] = camera.params[3];
  if (camera.model == CameraModel::kRadial) {
    result.params[4] = camera.params[3];
    result.params[5] = camera.params[4];
  }
  return result;
}

SelfCalibrationReport CheckCalibration(const SelfCalibrationOptions& options, const Camera& camera,
                                       const CalibrationProblem& problem) {
  SelfCalibrationReport report;
  report.camera = camera;
  const Camera given = WithDistortion(camera);
  Adjustment adjustment(options, given, problem, /*min_length=*/3);
  if (adjustment.empty()) return report;
  adjustment.FreeCamera({});
  const auto held = adjustment.Solve();
  // Of a solve that has not ended, the next one's gain would not be the distortion's.
  if (!held || !held->converged || held->cost <= 0.0) return report;
  // Tangential terms, freed, take up what bends in the map more than what the lens does.
  const std::vector<int> radial = CameraModelRadialParams(given.model);
  adjustment.FreeCamera(radial);
  const auto refined = adjustment.Solve();
  if (!refined) return report;
  report.cost_decrease = 1.0 - refined->cost / held->cost;
  report.accepted = report.cost_decrease >= options.min_cost_decrease;
  if (report.accepted) report.camera = adjustment.camera();

  // With the distortion, which takes up a part of what is wrong with them.
  std::vector<int> free_params = CameraModelPinholeParams(given.model);
  free_params.insert(free_params.end(), radial.begin(), radial.end());
  adjustment.FreeCamera(free_params);
  const auto pinhole = adjustment.Solve();
  if (!pinhole) return report;
  report.pinhole_cost_decrease = 1.0 - pinhole->cost / refined->cost;
  if (report.pinhole_cost_decrease >= kDoubtfulCostShare) {
    const Camera& better = adjustment.camera();
    report.better_pinhole = {better.FocalX(), better.FocalY(), better.PrincipalX(),
                             better.PrincipalY()};
  }
  return report;
}

std::string DescribeBetterPinhole(const std::vector<double>& better_pinhole, double cost_decrease) {
  return fmt::format(
      "focal lengths of {:.1f}, {:.1f} px and a principal point of ({:.1f}, {:.1f}) px, with a "
      "distortion to match, would remove {:.0f} % of the reprojection cost",
      better_pinhole[0], better_pinhole[1], better_pinhole[2], better_pinhole[3],
      100.0 * cost_decrease);
}

std::optional<CameraRefinement> RefineIntrinsics(const SelfCalibrationOptions& options,
                                                 const Camera& camera, const FocalPrior& prior,
                                                 const CalibrationProblem& problem) {
  S3LAM_CHECK(camera.model == CameraModel::kSimpleRadial || camera.model == CameraModel::kRadial);
  S3LAM_CHECK(prior.focal > 0.0 && prior.relative_sigma > 0.0);
  Adjustment adjustment(options, camera, problem, /*min_length=*/2);
  if (adjustment.empty()) return std::nullopt;
  adjustment.AddPrior(prior);
  std::vector<int> all(camera.params.size());
  std::iota(all.begin(), all.end(), 0);
  adjustment.FreeCamera(all);
  if (!adjustment.Solve()) return std::nullopt;
  const auto sigma = adjustment.SigmaOfFirstParam();
  if (!sigma) return std::nullopt;
  CameraRefinement refinement;
  refinement.camera = adjustment.camera();
  refinement.focal_sigma = *sigma;
  refinement.mean_score = adjustment.MeanScore();
  refinement.poses = adjustment.Poses(problem.poses);
  refinement.points = adjustment.points();
  return refinement;
}

std::optional<ReadoutRefinement> RefineReadout(const SelfCalibrationOptions& options,
                                               const Camera& camera,
                                               const CalibrationProblem& problem) {
  Adjustment adjustment(options, camera, problem, /*min_length=*/3, Adjustment::Shared::kReadout);
  if (adjustment.empty()) return std::nullopt;
  adjustment.FreeReadout(false);
  const auto held = adjustment.Solve();
  if (!held || held->cost <= 0.0) return std::nullopt;
  adjustment.FreeReadout(true);
  const auto refined = adjustment.Solve();
  const auto sigma = refined ? adjustment.SigmaOfFirstParam() : std::nullopt;
  if (!sigma) return std::nullopt;
  return ReadoutRefinement{adjustment.readout(), *sigma, 1.0 - refined->cost / held->cost};
}

double FocalSigmaBetweenParts(const SelfCalibrationOptions& options, const Camera& camera,
                              const FocalPrior& prior, const CalibrationProblem& problem) {
  const int num_poses = static_cast<int>(problem.poses.size());
  std::vector<double> focals;
  std::vector<double> weights;
  for (int part = 0; part < kNumParts; ++part) {
    const auto refined = RefineIntrinsics(
        options, camera, prior,
        PartOf(problem, part * num_poses / kNumParts, (part + 1) * num_poses / kNumParts));
    if (!refined) continue;
    focals.push_back(refined->camera.FocalX());
    weights.push_back(1.0 / (refined->focal_sigma * refined->focal_sigma));
  }
  if (focals.size() < 2) return 0.0;
  const auto count = static_cast<Eigen::Index>(focals.size());
  const Eigen::Map<const Eigen::ArrayXd> f(focals.data(), count);
  const Eigen::Map<const Eigen::ArrayXd> w(weights.data(), count);
  const double sum = w.sum();
  const double mean = (w * f).sum() / sum;
  const double chi_square = (w * (f - mean).square()).sum();
  const double excess = std::max(0.0, chi_square - static_cast<double>(count - 1));
  const double variance = excess / (sum - w.square().sum() / sum);  // Between the parts.
  return std::sqrt(variance * w.square().sum()) / sum;
}

}  // namespace s3lam
