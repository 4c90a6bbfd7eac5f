#include "s3lam/robust/absolute_pose.h"

#include <opencv2/calib3d.hpp>

#include "data_order.h"
#include "s3lam/base/error.h"

namespace s3lam {

std::optional<AbsolutePose> EstimateAbsolutePose(std::span<const Eigen::Vector3d> points_in_world,
                                                 std::span<const Eigen::Vector2d> normalized,
                                                 double threshold, uint64_t seed) {
  constexpr int kMaxIterations = 500;
  constexpr double kConfidence = 0.999;
  S3LAM_CHECK(points_in_world.size() == normalized.size());
  if (points_in_world.size() < 4) return std::nullopt;
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> image;
  const std::vector<size_t> order = internal::DataOrder(points_in_world.size(), seed);
  for (const size_t i : order) {
    const Eigen::Vector3d& x = points_in_world[i];
    object.emplace_back(x.x(), x.y(), x.z());
    image.emplace_back(normalized[i].x(), normalized[i].y());
  }
  cv::Vec3d rotation;
  cv::Vec3d translation;
  std::vector<int> inliers;
  const bool found = cv::solvePnPRansac(
      object, image, cv::Matx33d::eye(), cv::noArray(), rotation, translation, false,
      kMaxIterations, static_cast<float>(threshold), kConfidence, inliers, cv::SOLVEPNP_AP3P);
  if (!found || inliers.size() < 4) return std::nullopt;
  AbsolutePose pose;
  pose.cam_from_world.rotation =
      QuaternionFromRotationVector({rotation[0], rotation[1], rotation[2]});
  pose.cam_from_world.translation = {translation[0], translation[1], translation[2]};
  if (!pose.cam_from_world.translation.allFinite() ||
      !pose.cam_from_world.rotation.coeffs().allFinite()) {
    return std::nullopt;
  }
  pose.is_inlier.assign(points_in_world.size(), 0);
  for (const int i : inliers) pose.is_inlier[order[static_cast<size_t>(i)]] = 1;
  pose.num_inliers = static_cast<int>(inliers.size());
  return pose;
}

}  // namespace s3lam
