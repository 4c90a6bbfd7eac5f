#include "s3lam/geometry/alignment.h"

#include <Eigen/SVD>

#include "s3lam/base/error.h"

namespace s3lam {

std::optional<Similarity3> AlignPoints(std::span<const Eigen::Vector3d> points_in_a,
                                       std::span<const Eigen::Vector3d> points_in_b,
                                       bool with_scale) {
  S3LAM_CHECK(points_in_a.size() == points_in_b.size());
  if (points_in_a.size() < 3) return std::nullopt;
  const double n = static_cast<double>(points_in_a.size());
  Eigen::Vector3d mean_a = Eigen::Vector3d::Zero();
  Eigen::Vector3d mean_b = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < points_in_a.size(); ++i) {
    mean_a += points_in_a[i] / n;
    mean_b += points_in_b[i] / n;
  }
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  double variance_b = 0.0;
  for (size_t i = 0; i < points_in_a.size(); ++i) {
    covariance += (points_in_a[i] - mean_a) * (points_in_b[i] - mean_b).transpose() / n;
    variance_b += (points_in_b[i] - mean_b).squaredNorm() / n;
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d& singular = svd.singularValues();
  if (!singular.allFinite() || singular[1] <= 1e-12 * singular[0] || singular[0] <= 0.0) {
    return std::nullopt;
  }
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0.0) signs[2] = -1.0;
  Similarity3 a_from_b;
  const Eigen::Matrix3d rotation = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  a_from_b.rotation = Eigen::Quaterniond(rotation).normalized();
  if (with_scale) a_from_b.scale = singular.dot(signs) / variance_b;
  a_from_b.translation = mean_a - a_from_b.scale * (a_from_b.rotation * mean_b);
  return a_from_b;
}

}  // namespace s3lam
