#include "s3lam/optim/self_calibration.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

constexpr int kMaxParams = 12;
constexpr double kHuberSigma = 2.4477;  // sqrt(5.991)

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

/// The same camera with a model that has the usual distortion terms.
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

/// Points with the longest tracks until there are enough observations; true per chosen point.
std::vector<uint8_t> ChoosePoints(const CalibrationProblem& problem, int max_observations) {
  std::vector<int> lengths(problem.points.size(), 0);
  for (const auto& o : problem.observations) ++lengths[o.point];
  std::vector<int> order(problem.points.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return lengths[a] > lengths[b]; });
  std::vector<uint8_t> chosen(problem.points.size(), 0);
  int count = 0;
  for (const int point : order) {
    if (lengths[point] < 3 || count >= max_observations) break;
    chosen[point] = 1;
    count += lengths[point];
  }
  return chosen;
}

class Adjustment {
 public:
  Adjustment(const SelfCalibrationOptions& options, const Camera& camera,
             const CalibrationProblem& input)
      : options_(options), camera_(camera), points_(input.points), poses_(input.poses.size()) {
    for (size_t i = 0; i < poses_.size(); ++i) {
      const Eigen::Vector3d& t = input.poses[i].translation;
      poses_[i] = {0.0, 0.0, 0.0, t.x(), t.y(), t.z()};
    }
    const std::vector<uint8_t> chosen = ChoosePoints(input, options.max_observations);
    auto* loss = new ceres::HuberLoss(kHuberSigma);
    for (const auto& o : input.observations) {
      const Rigid3& pose = input.poses[o.pose];
      if (chosen[o.point] == 0 || (pose * input.points[o.point]).z() <= 1e-6) continue;
      problem_.AddResidualBlock(MakeCost(o, pose), loss, poses_[o.pose].data(),
                                points_[o.point].data(), camera_.params.data());
    }
  }

  [[nodiscard]] bool empty() const { return problem_.NumResidualBlocks() == 0; }
  [[nodiscard]] const Camera& camera() const { return camera_; }

  /// Cost after solving with the distortion held or free; empty if there is no usable solution.
  std::optional<double> Solve(bool distortion_is_free) {
    HoldCamera(distortion_is_free);
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
    ordering->AddElementToGroup(camera_.params.data(), 1);
    solver.linear_solver_ordering = ordering;
    std::string error;
    S3LAM_CHECK_MSG(solver.IsValid(&error), "{}", error);
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem_, &summary);
    if (!summary.IsSolutionUsable()) return std::nullopt;
    return summary.final_cost;
  }

 private:
  [[nodiscard]] ceres::CostFunction* MakeCost(const CalibrationProblem::Observation& o,
                                              const Rigid3& pose) const {
    auto* error = new ReprojectionError{camera_.model, pose.rotation.toRotationMatrix(), o.pixel,
                                        o.inverse_sigma};
    switch (camera_.params.size()) {
      case 5:
        return new ceres::AutoDiffCostFunction<ReprojectionError, 2, 6, 3, 5>(error);
      case 8:
        return new ceres::AutoDiffCostFunction<ReprojectionError, 2, 6, 3, 8>(error);
      default:
        return new ceres::AutoDiffCostFunction<ReprojectionError, 2, 6, 3, kMaxParams>(error);
    }
  }

  /// Focal length and principal point are always held; the gauge by the first pose.
  void HoldCamera(bool distortion_is_free) {
    double* params = camera_.params.data();
    if (!distortion_is_free) {
      for (auto& pose : poses_) {
        if (!problem_.HasParameterBlock(pose.data())) continue;
        problem_.SetParameterBlockConstant(pose.data());
        break;
      }
      problem_.SetParameterBlockConstant(params);
      return;
    }
    problem_.SetParameterBlockVariable(params);
    problem_.SetManifold(
        params, new ceres::SubsetManifold(static_cast<int>(camera_.params.size()), {0, 1, 2, 3}));
  }

  const SelfCalibrationOptions& options_;
  Camera camera_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<std::array<double, 6>> poses_;
  ceres::Problem problem_;
};

}  // namespace

void SelfCalibrationOptions::Visit(OptionVisitor& v) {
  v.Value("enabled", enabled,
          "check whether the lens distortion explains the images, and refine it");
  v.Value("min_cost_decrease", min_cost_decrease,
          "share of the reprojection cost that a refined distortion must remove to be accepted",
          0.0, 1.0);
  v.Value("max_observations", max_observations, "observations used, longest tracks first", 100,
          100000000);
  v.Value("max_iterations", max_iterations, "of each solve", 1, 1000);
}

SelfCalibrationReport RefineDistortion(const SelfCalibrationOptions& options, const Camera& camera,
                                       const CalibrationProblem& problem) {
  SelfCalibrationReport report;
  report.camera = camera;
  Adjustment adjustment(options, WithDistortion(camera), problem);
  if (adjustment.empty()) return report;
  const auto held = adjustment.Solve(/*distortion_is_free=*/false);
  if (!held || *held <= 0.0) return report;
  const auto refined = adjustment.Solve(/*distortion_is_free=*/true);
  if (!refined) return report;
  report.cost_decrease = 1.0 - *refined / *held;
  report.accepted = report.cost_decrease >= options.min_cost_decrease;
  if (report.accepted) report.camera = adjustment.camera();
  return report;
}

}  // namespace s3lam
