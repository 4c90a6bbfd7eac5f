#include "s3lam/slam/similarity_estimator.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "s3lam/geometry/alignment.h"
#include "s3lam/robust/ransac.h"

namespace s3lam {
namespace {

constexpr double kThresholdSigma = 3.0349;  // sqrt(9.21): 99 % of chi-squared with 2 dof
constexpr int kRefinementIterations = 5;
constexpr uint64_t kSeed = 21;

using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;
using Matrix3x7 = Eigen::Matrix<double, 3, 7>;

/// Derivative of exp(omega, tau, lambda) * x, a small similarity applied from the left.
Matrix3x7 ActionJacobian(const Eigen::Vector3d& x) {
  Matrix3x7 jacobian;
  jacobian << -CrossMatrix(x), Eigen::Matrix3d::Identity(), x;
  return jacobian;
}

/// Sums of the normal equations.
struct Normals {
  Matrix7 hessian = Matrix7::Zero();
  Vector7 gradient = Vector7::Zero();

  /// One camera's residual, `by_similarity` being the derivative of the point in it.
  void Add(const PinholeIntrinsics& camera, const Eigen::Vector3d& x, const Eigen::Vector2d& xy,
           double inverse_sigma, const Matrix3x7& by_similarity) {
    if (x.z() <= 1e-9) return;
    const Eigen::Vector2d residual = inverse_sigma * (camera.Project(x) - xy);
    const double norm = residual.norm();
    const double weight = norm > kThresholdSigma ? kThresholdSigma / norm : 1.0;
    const Eigen::Matrix<double, 2, 7> jacobian =
        inverse_sigma * camera.ProjectionJacobian(x) * by_similarity;
    hessian.noalias() += weight * jacobian.transpose() * jacobian;
    gradient.noalias() += weight * jacobian.transpose() * residual;
  }
};

Similarity3 Moved(const Similarity3& s, const Vector7& step) {
  const Similarity3 small{std::exp(step[6]), QuaternionFromRotationVector(step.head<3>()),
                          step.segment<3>(3)};
  return small * s;
}

class SimilarityEstimator {
 public:
  using Model = Similarity3;
  static constexpr size_t kSampleSize = 3;
  static constexpr RansacLoss kLoss = RansacLoss::kTruncated;

  SimilarityEstimator(const PinholeIntrinsics& camera, const std::vector<PointPair>& pairs)
      : camera_(camera), pairs_(pairs) {}

  [[nodiscard]] size_t size() const { return pairs_.size(); }
  [[nodiscard]] std::array<size_t, kSampleSize> DrawSample(Rng& rng) const {
    return DrawUniformSample<kSampleSize>(size(), rng);
  }
  void Estimate(const std::array<size_t, kSampleSize>& sample, std::vector<Model>& models) const {
    std::array<Eigen::Vector3d, kSampleSize> in_a;
    std::array<Eigen::Vector3d, kSampleSize> in_b;
    for (size_t i = 0; i < kSampleSize; ++i) {
      in_a[i] = pairs_[sample[i]].in_a;
      in_b[i] = pairs_[sample[i]].in_b;
    }
    const auto a_from_b = AlignPoints(in_a, in_b);
    if (a_from_b && a_from_b->scale > 0.0 && std::isfinite(a_from_b->scale)) {
      models.push_back(*a_from_b);
    }
  }
  [[nodiscard]] double SquaredError(const Model& model, size_t i) const {
    return SquaredPairError(camera_, model, pairs_[i]);
  }
  [[nodiscard]] std::optional<Model> Refine(const Model& model,
                                            std::span<const size_t> inliers) const {
    return RefineSimilarity(camera_, pairs_, inliers, model);
  }

 private:
  const PinholeIntrinsics& camera_;
  const std::vector<PointPair>& pairs_;
};

}  // namespace

double SquaredPairError(const PinholeIntrinsics& camera, const Similarity3& a_from_b,
                        const PointPair& pair) {
  const Eigen::Vector3d in_a = a_from_b * pair.in_b;
  const Eigen::Vector3d in_b = a_from_b.Inverse() * pair.in_a;
  if (in_a.z() <= 1e-9 || in_b.z() <= 1e-9) return std::numeric_limits<double>::infinity();
  const double error_a = (pair.inverse_sigma_a * (camera.Project(in_a) - pair.xy_a)).squaredNorm();
  const double error_b = (pair.inverse_sigma_b * (camera.Project(in_b) - pair.xy_b)).squaredNorm();
  return std::max(error_a, error_b);
}

std::optional<Similarity3> RefineSimilarity(const PinholeIntrinsics& camera,
                                            const std::vector<PointPair>& pairs,
                                            std::span<const size_t> used,
                                            const Similarity3& a_from_b) {
  Similarity3 s = a_from_b;
  for (int iteration = 0; iteration < kRefinementIterations; ++iteration) {
    Normals normals;
    const Similarity3 inverse = s.Inverse();
    const Eigen::Matrix3d inverse_linear = inverse.scale * inverse.rotation.toRotationMatrix();
    for (const size_t i : used) {
      const PointPair& pair = pairs[i];
      const Eigen::Vector3d in_a = s * pair.in_b;
      normals.Add(camera, in_a, pair.xy_a, pair.inverse_sigma_a, ActionJacobian(in_a));
      normals.Add(camera, inverse * pair.in_a, pair.xy_b, pair.inverse_sigma_b,
                  -inverse_linear * ActionJacobian(pair.in_a));
    }
    const Eigen::LDLT<Matrix7> factor(normals.hessian);
    if (factor.info() != Eigen::Success || !factor.isPositive()) return std::nullopt;
    const Vector7 step = -factor.solve(normals.gradient);
    if (!step.allFinite() || std::abs(step[6]) > 3.0) return std::nullopt;
    s = Moved(s, step);
    if (step.norm() < 1e-9) break;
  }
  return s;
}

std::optional<SimilarityFit> EstimateSimilarity(const PinholeIntrinsics& camera,
                                                const std::vector<PointPair>& pairs,
                                                size_t min_inliers, uint64_t seed) {
  if (pairs.size() < std::max<size_t>(min_inliers, 3)) return std::nullopt;
  Rng rng(kSeed + seed);
  RansacOptions options;
  options.max_iterations = 300;
  const auto result = Ransac(SimilarityEstimator(camera, pairs), kThresholdSigma, options, rng);
  if (!result || result->inliers.size() < min_inliers) return std::nullopt;
  return SimilarityFit{result->model, result->inliers};
}

}  // namespace s3lam
