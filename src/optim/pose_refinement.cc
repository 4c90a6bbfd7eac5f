#include "s3lam/optim/pose_refinement.h"

#include <Eigen/Cholesky>
#include <cmath>

namespace s3lam {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double kChi2 = 5.991;  // 95 % with 2 degrees of freedom.
constexpr double kHuber = 2.4477;
constexpr int kRounds = 4;
constexpr int kStepsPerRound = 5;
constexpr double kSmallStep = 1e-10;

struct Normal {
  Matrix6 hessian = Matrix6::Zero();
  Vector6 gradient = Vector6::Zero();
};

Normal Linearize(const PinholeIntrinsics& camera, const std::vector<PoseObservation>& observations,
                 const std::vector<uint8_t>& is_used, bool robust, const Rigid3& pose) {
  Normal normal;
  const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
  for (size_t i = 0; i < observations.size(); ++i) {
    if (is_used[i] == 0) continue;
    const PoseObservation& o = observations[i];
    const Eigen::Vector3d rotated = rotation * o.point_in_world;
    const Eigen::Vector3d x = rotated + pose.translation;
    if (x.z() <= 1e-9) continue;
    const Eigen::Vector2d residual = o.inverse_sigma * (camera.Project(x) - o.xy);
    const double norm = residual.norm();
    const double weight = robust && norm > kHuber ? kHuber / norm : 1.0;
    const Eigen::Matrix<double, 2, 3> projection = o.inverse_sigma * camera.ProjectionJacobian(x);
    Eigen::Matrix<double, 2, 6> jacobian;
    jacobian.leftCols<3>().noalias() = -projection * CrossMatrix(rotated);
    jacobian.rightCols<3>() = projection;
    normal.hessian.noalias() += weight * jacobian.transpose() * jacobian;
    normal.gradient.noalias() += weight * jacobian.transpose() * residual;
  }
  return normal;
}

}  // namespace

PoseRefinementResult RefinePose(const PinholeIntrinsics& camera,
                                const std::vector<PoseObservation>& observations,
                                Rigid3& cam_from_world) {
  PoseRefinementResult result;
  result.is_inlier.assign(observations.size(), 1);
  Rigid3 pose = cam_from_world;
  for (int round = 0; round < kRounds; ++round) {
    const bool robust = round < 2;  // The last rounds see inliers only.
    for (int step = 0; step < kStepsPerRound; ++step) {
      const Normal normal = Linearize(camera, observations, result.is_inlier, robust, pose);
      const Vector6 delta = -normal.hessian.ldlt().solve(normal.gradient);
      if (!delta.allFinite()) break;
      const Eigen::Quaterniond turn = QuaternionFromRotationVector(delta.head<3>());
      pose.rotation = (turn * pose.rotation).normalized();
      pose.translation += delta.tail<3>();
      if (delta.squaredNorm() < kSmallStep) break;
    }
    result.num_inliers = 0;
    for (size_t i = 0; i < observations.size(); ++i) {
      const PoseObservation& o = observations[i];
      result.is_inlier[i] =
          SquaredError(camera, pose, o.point_in_world, o.xy, o.inverse_sigma) <= kChi2;
      result.num_inliers += result.is_inlier[i];
    }
    if (result.num_inliers < 6) return result;  // Too few to go on; the pose is left as it was.
  }
  result.information =
      Linearize(camera, observations, result.is_inlier, /*robust=*/false, pose).hessian;
  cam_from_world = pose;
  return result;
}

}  // namespace s3lam
