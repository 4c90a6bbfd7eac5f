#include "s3lam/optim/bundle_adjustment.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "s3lam/base/error.h"
#include "s3lam/base/parallel.h"
#include "s3lam/optim/block_cholesky.h"
#include "s3lam/optim/huber.h"

namespace s3lam {
namespace {

using Matrix2x6 = Eigen::Matrix<double, 2, 6>;
using Matrix2x3 = Eigen::Matrix<double, 2, 3>;
using Matrix6x3 = Eigen::Matrix<double, 6, 3>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double kMinDepth = 1e-9;
/// Squared error, in sigma, that an observation from behind counts as.
constexpr double kBehindSquaredError = 1e6;
constexpr size_t kObservationsPerChunk = 2000;
constexpr size_t kMaxChunks = 4;
/// Largest reduced system that is factored densely, and fill above which a larger one is too.
constexpr int kMaxDenseRows = 900;
constexpr double kDenseFill = 0.3;

/// Where the variables are: poses without the fixed ones, and each point's observations.
struct Layout {
  std::vector<int> variable_of_pose;  // -1 if fixed
  std::vector<int> pose_of_variable;
  std::vector<size_t> point_begin;  // Observation range of each point, one more entry than points.
  std::vector<size_t> chunk_begin;  // Point range of each chunk, one more entry than chunks.
  // Upper-triangular blocks of the reduced system: row i has columns block_column[k] for k in
  // [row_begin[i], row_begin[i+1]), ascending, the diagonal first.
  std::vector<int> row_begin;
  std::vector<int> block_column;

  [[nodiscard]] int num_variables() const { return static_cast<int>(pose_of_variable.size()); }
  [[nodiscard]] size_t num_chunks() const { return chunk_begin.size() - 1; }
  [[nodiscard]] int Block(int i, int j) const {
    const auto begin = block_column.begin() + row_begin[i];
    const auto end = block_column.begin() + row_begin[i + 1];
    return static_cast<int>(std::lower_bound(begin, end, j) - block_column.begin());
  }
};

void FindPointRanges(const BaProblem& problem, Layout& layout) {
  layout.point_begin.assign(problem.points.size() + 1, 0);
  int previous = 0;
  for (const BaObservation& observation : problem.observations) {
    S3LAM_CHECK(observation.point >= previous);
    previous = observation.point;
    ++layout.point_begin[static_cast<size_t>(observation.point) + 1];
  }
  for (size_t p = 0; p < problem.points.size(); ++p) {
    layout.point_begin[p + 1] += layout.point_begin[p];
  }
}

void CutIntoChunks(const BaProblem& problem, Layout& layout) {
  const size_t count = problem.observations.size();
  const size_t chunks = std::clamp<size_t>(count / kObservationsPerChunk, 1, kMaxChunks);
  layout.chunk_begin = {0};
  for (size_t c = 1; c < chunks; ++c) {
    const auto it =
        std::lower_bound(layout.point_begin.begin(), layout.point_begin.end(), count * c / chunks);
    layout.chunk_begin.push_back(static_cast<size_t>(it - layout.point_begin.begin()));
  }
  layout.chunk_begin.push_back(problem.points.size());
}

void FindBlocks(const BaProblem& problem, Layout& layout) {
  const size_t n = layout.pose_of_variable.size();
  std::vector<std::vector<int>> columns(n);
  std::vector<int> seen;
  for (size_t p = 0; p < problem.points.size(); ++p) {
    seen.clear();
    for (size_t k = layout.point_begin[p]; k < layout.point_begin[p + 1]; ++k) {
      const int v = layout.variable_of_pose[problem.observations[k].pose];
      if (v >= 0) seen.push_back(v);
    }
    for (const int i : seen) {
      for (const int j : seen) {
        if (i < j) columns[i].push_back(j);
      }
    }
    // Keep the lists short while they grow.
    for (const int i : seen) {
      if (columns[i].size() > 4 * n + 64) {
        std::sort(columns[i].begin(), columns[i].end());
        columns[i].erase(std::unique(columns[i].begin(), columns[i].end()), columns[i].end());
      }
    }
  }
  layout.row_begin = {0};
  for (size_t i = 0; i < n; ++i) {
    std::sort(columns[i].begin(), columns[i].end());
    columns[i].erase(std::unique(columns[i].begin(), columns[i].end()), columns[i].end());
    layout.block_column.push_back(static_cast<int>(i));
    layout.block_column.insert(layout.block_column.end(), columns[i].begin(), columns[i].end());
    layout.row_begin.push_back(static_cast<int>(layout.block_column.size()));
  }
}

Layout MakeLayout(const BaProblem& problem) {
  Layout layout;
  layout.variable_of_pose.assign(problem.poses.size(), -1);
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    if (problem.pose_is_fixed[i] != 0) continue;
    layout.variable_of_pose[i] = static_cast<int>(layout.pose_of_variable.size());
    layout.pose_of_variable.push_back(static_cast<int>(i));
  }
  FindPointRanges(problem, layout);
  CutIntoChunks(problem, layout);
  FindBlocks(problem, layout);
  return layout;
}

/// The reduced system without its values.
BlockMatrix ReducedPattern(const Layout& layout) {
  std::vector<std::vector<int>> columns(layout.pose_of_variable.size());
  for (size_t i = 0; i < columns.size(); ++i) {
    columns[i].assign(layout.block_column.begin() + layout.row_begin[i] + 1,
                      layout.block_column.begin() + layout.row_begin[i + 1]);
  }
  return {std::vector<int>(columns.size(), 6), columns};
}

bool IsDense(const Layout& layout) {
  const auto n = static_cast<double>(layout.num_variables());
  const double fill = 2.0 * static_cast<double>(layout.block_column.size()) / (n * n);
  return 6.0 * n <= kMaxDenseRows || fill > kDenseFill;
}

/// Sums of one chunk of points over the poses' blocks.
struct PoseSums {
  std::vector<Matrix6> blocks;    // Of the reduced system, as in Layout.
  std::vector<Vector6> gradient;  // Per variable pose.
  std::vector<Matrix6> hessian;   // Undamped diagonal, per variable pose.
};

/// The normal equations: what is needed to solve for a step and to try another damping.
struct NormalEquations {
  std::vector<Matrix6x3> pose_point;  // W, per observation
  std::vector<Eigen::Matrix3d> point_hessian;
  std::vector<Eigen::Vector3d> point_gradient;
  std::vector<Vector6> pose_gradient;
  std::vector<Matrix6> pose_hessian;
};

class Solver {
 public:
  Solver(const BundleAdjustmentOptions& options, BaProblem& problem)
      : options_(options), problem_(problem), layout_(MakeLayout(problem)) {
    equations_.pose_point.resize(problem.observations.size());
    equations_.point_hessian.resize(problem.points.size());
    equations_.point_gradient.resize(problem.points.size());
    chunks_.resize(layout_.num_chunks());
    inverse_point_hessian_.resize(problem.points.size());
    reduced_ = ReducedPattern(layout_);
    factor_ = IsDense(layout_) ? MakeDenseCholesky(reduced_) : MakeSparseCholesky(reduced_);
  }

  BundleAdjustmentReport Run() {
    BundleAdjustmentReport report;
    report.initial_cost = Cost(problem_.poses, problem_.points);
    double cost = report.initial_cost;
    double lambda = 1e-4;
    double raise = 2.0;
    bool relinearize = true;
    for (int i = 0; i < options_.max_iterations; ++i) {
      if (relinearize) Linearize();
      ++report.num_iterations;
      const double trial = TryStep(lambda);
      if (!(trial < cost)) {  // Not better, or not a number.
        lambda *= raise;
        raise *= 2.0;
        relinearize = false;
        if (lambda > 1e8) break;
        continue;
      }
      problem_.poses.swap(trial_poses_);
      problem_.points.swap(trial_points_);
      const double decrease = cost - trial;
      cost = trial;
      lambda = std::max(lambda * 0.2, 1e-10);
      raise = 2.0;
      relinearize = true;
      if (decrease < options_.min_relative_decrease * cost) break;
    }
    report.final_cost = cost;
    report.usable = std::isfinite(cost);
    return report;
  }

 private:
  [[nodiscard]] double Cost(const std::vector<Rigid3>& poses,
                            const std::vector<Eigen::Vector3d>& points) const {
    std::vector<double> costs(layout_.num_chunks(), 0.0);
    ParallelFor(costs.size(), options_.num_threads, [&](size_t c) {
      double sum = 0.0;
      for (size_t k = layout_.point_begin[layout_.chunk_begin[c]];
           k < layout_.point_begin[layout_.chunk_begin[c + 1]]; ++k) {
        const BaObservation& o = problem_.observations[k];
        const double squared =
            SquaredError(problem_.camera, poses[o.pose], points[o.point], o.xy, o.inverse_sigma);
        sum += Huber(std::min(squared, kBehindSquaredError), options_.huber_sigma);
      }
      costs[c] = 0.5 * sum;
    });
    double total = 0.0;
    for (const double c : costs) total += c;
    return total;
  }

  void Linearize() {
    rotations_.resize(problem_.poses.size());
    for (size_t i = 0; i < rotations_.size(); ++i) {
      rotations_[i] = problem_.poses[i].rotation.toRotationMatrix();
    }
    ParallelFor(chunks_.size(), options_.num_threads, [&](size_t c) { LinearizeChunk(c); });
    const size_t n = layout_.pose_of_variable.size();
    equations_.pose_gradient.assign(n, Vector6::Zero());
    equations_.pose_hessian.assign(n, Matrix6::Zero());
    for (const PoseSums& sums : chunks_) {
      for (size_t i = 0; i < n; ++i) {
        equations_.pose_gradient[i] += sums.gradient[i];
        equations_.pose_hessian[i] += sums.hessian[i];
      }
    }
  }

  void LinearizeChunk(size_t c) {
    PoseSums& sums = chunks_[c];
    sums.gradient.assign(layout_.pose_of_variable.size(), Vector6::Zero());
    sums.hessian.assign(layout_.pose_of_variable.size(), Matrix6::Zero());
    for (size_t p = layout_.chunk_begin[c]; p < layout_.chunk_begin[c + 1]; ++p) {
      Eigen::Matrix3d point_hessian = Eigen::Matrix3d::Zero();
      Eigen::Vector3d point_gradient = Eigen::Vector3d::Zero();
      for (size_t k = layout_.point_begin[p]; k < layout_.point_begin[p + 1]; ++k) {
        LinearizeObservation(k, sums, point_hessian, point_gradient);
      }
      equations_.point_hessian[p] = point_hessian;
      equations_.point_gradient[p] = point_gradient;
    }
  }

  /// r = inverse_sigma (project(R X + t) - xy), weighted by the square root of Huber's weight;
  /// the pose moves as R <- exp(omega) R, t <- t + tau.
  void LinearizeObservation(size_t k, PoseSums& sums, Eigen::Matrix3d& point_hessian,
                            Eigen::Vector3d& point_gradient) {
    const BaObservation& o = problem_.observations[k];
    const PinholeIntrinsics& camera = problem_.camera;
    const Eigen::Matrix3d& rotation = rotations_[o.pose];
    const Eigen::Vector3d rotated = rotation * problem_.points[o.point];
    const Eigen::Vector3d x = rotated + problem_.poses[o.pose].translation;
    equations_.pose_point[k].setZero();
    if (x.z() <= kMinDepth) return;
    Eigen::Vector2d residual = o.inverse_sigma * (camera.Project(x) - o.xy);
    const double norm = residual.norm();
    const double weight = norm > options_.huber_sigma ? options_.huber_sigma / norm : 1.0;
    const double scale = o.inverse_sigma * std::sqrt(weight);
    residual *= std::sqrt(weight);
    const Matrix2x3 projection = scale * camera.ProjectionJacobian(x);
    const Matrix2x3 by_point = projection * rotation;
    point_hessian.noalias() += by_point.transpose() * by_point;
    point_gradient.noalias() += by_point.transpose() * residual;
    const int variable = layout_.variable_of_pose[o.pose];
    if (variable < 0) return;
    Matrix2x6 by_pose;
    by_pose.leftCols<3>().noalias() = -projection * CrossMatrix(rotated);
    by_pose.rightCols<3>() = projection;
    sums.hessian[variable].noalias() += by_pose.transpose() * by_pose;
    sums.gradient[variable].noalias() += by_pose.transpose() * residual;
    equations_.pose_point[k].noalias() = by_pose.transpose() * by_point;
  }

  /// Solves with this damping, fills the trial state, returns its cost (NaN if there is no
  /// solution).
  double TryStep(double lambda) {
    ParallelFor(chunks_.size(), options_.num_threads, [&](size_t c) { EliminateChunk(c, lambda); });
    const int n = layout_.num_variables();
    reduced_.Allocate();
    Eigen::VectorXd right(6 * n);
    for (int i = 0; i < n; ++i) {
      Matrix6 diagonal = equations_.pose_hessian[i];
      diagonal.diagonal() *= 1.0 + lambda;
      diagonal.diagonal().array() += 1e-12;
      auto panel = reduced_.panel(i);
      panel.topRows<6>() = diagonal;
      right.segment<6>(6 * i) = -equations_.pose_gradient[i];
      for (const PoseSums& sums : chunks_) {
        for (int b = layout_.row_begin[i]; b < layout_.row_begin[i + 1]; ++b) {
          panel.middleRows<6>(6 * (b - layout_.row_begin[i])) += sums.blocks[b].transpose();
        }
        right.segment<6>(6 * i) += sums.gradient[i];
      }
    }
    Eigen::VectorXd step;
    if (n > 0 && !factor_->Solve(reduced_, right, step))
      return std::numeric_limits<double>::quiet_NaN();
    ApplyPoseStep(step);
    trial_points_.resize(problem_.points.size());
    ParallelFor(chunks_.size(), options_.num_threads, [&](size_t c) { StepPoints(c, step); });
    return Cost(trial_poses_, trial_points_);
  }

  /// Schur complement of one chunk's points: - W V^-1 W^T and + W V^-1 g_point.
  void EliminateChunk(size_t c, double lambda) {
    PoseSums& sums = chunks_[c];
    sums.blocks.assign(layout_.block_column.size(), Matrix6::Zero());
    sums.gradient.assign(layout_.pose_of_variable.size(), Vector6::Zero());
    for (size_t p = layout_.chunk_begin[c]; p < layout_.chunk_begin[c + 1]; ++p) {
      Eigen::Matrix3d damped = equations_.point_hessian[p];
      damped.diagonal() *= 1.0 + lambda;
      damped.diagonal().array() += 1e-12;
      const Eigen::Matrix3d inverse = damped.inverse();
      inverse_point_hessian_[p] = inverse;
      const size_t begin = layout_.point_begin[p];
      const size_t end = layout_.point_begin[p + 1];
      for (size_t a = begin; a < end; ++a) {
        const int i = layout_.variable_of_pose[problem_.observations[a].pose];
        if (i < 0) continue;
        const Matrix6x3 eliminated = equations_.pose_point[a] * inverse;
        sums.gradient[i].noalias() += eliminated * equations_.point_gradient[p];
        for (size_t b = begin; b < end; ++b) {
          const int j = layout_.variable_of_pose[problem_.observations[b].pose];
          if (j < i) continue;
          sums.blocks[layout_.Block(i, j)].noalias() -=
              eliminated * equations_.pose_point[b].transpose();
        }
      }
    }
  }

  void ApplyPoseStep(const Eigen::VectorXd& step) {
    trial_poses_ = problem_.poses;
    for (int i = 0; i < layout_.num_variables(); ++i) {
      Rigid3& pose = trial_poses_[layout_.pose_of_variable[i]];
      const Eigen::Quaterniond turn = QuaternionFromRotationVector(step.segment<3>(6 * i));
      pose.rotation = (turn * pose.rotation).normalized();
      pose.translation += step.segment<3>(6 * i + 3);
    }
  }

  void StepPoints(size_t c, const Eigen::VectorXd& step) {
    for (size_t p = layout_.chunk_begin[c]; p < layout_.chunk_begin[c + 1]; ++p) {
      Eigen::Vector3d right = -equations_.point_gradient[p];
      for (size_t k = layout_.point_begin[p]; k < layout_.point_begin[p + 1]; ++k) {
        const int i = layout_.variable_of_pose[problem_.observations[k].pose];
        if (i >= 0)
          right.noalias() -= equations_.pose_point[k].transpose() * step.segment<6>(6 * i);
      }
      trial_points_[p] = problem_.points[p] + inverse_point_hessian_[p] * right;
    }
  }

  const BundleAdjustmentOptions& options_;
  BaProblem& problem_;
  Layout layout_;
  std::vector<Eigen::Matrix3d> rotations_;
  NormalEquations equations_;
  std::vector<PoseSums> chunks_;
  std::vector<Eigen::Matrix3d> inverse_point_hessian_;
  BlockMatrix reduced_;
  std::unique_ptr<BlockCholesky> factor_;
  std::vector<Rigid3> trial_poses_;
  std::vector<Eigen::Vector3d> trial_points_;
};

}  // namespace

void BundleAdjustmentOptions::Visit(OptionVisitor& v) {
  v.Value("max_iterations", max_iterations, "steps tried at the most", 1, 10000);
  v.Value("huber_sigma", huber_sigma, "where the robust loss turns linear [sigma]", 1e-3, 1e6);
  v.Value("min_relative_decrease", min_relative_decrease, "of the cost, to go on", 0.0, 1.0);
}

double SquaredError(const PinholeIntrinsics& camera, const Rigid3& cam_from_world,
                    const Eigen::Vector3d& point, const Eigen::Vector2d& xy, double inverse_sigma) {
  const Eigen::Vector3d x = cam_from_world * point;
  if (!(x.z() > kMinDepth)) return std::numeric_limits<double>::infinity();
  return (inverse_sigma * (camera.Project(x) - xy)).squaredNorm();
}

BundleAdjustmentReport AdjustBundle(const BundleAdjustmentOptions& options, BaProblem& problem) {
  S3LAM_CHECK(problem.pose_is_fixed.size() == problem.poses.size());
  return Solver(options, problem).Run();
}

}  // namespace s3lam
