#include "s3lam/robust/relative_pose.h"

#include <opencv2/calib3d.hpp>

#include "data_order.h"
#include "s3lam/base/error.h"

namespace s3lam {
namespace {

constexpr double kConfidence = 0.9999;
constexpr int kMaxIterations = 2000;

Rigid3 MakePose(const cv::Mat& rotation, const cv::Mat& translation, double sign) {
  Eigen::Matrix3d matrix;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) matrix(r, c) = rotation.at<double>(r, c);
  }
  const Eigen::Vector3d t(translation.at<double>(0), translation.at<double>(1),
                          translation.at<double>(2));
  return {Eigen::Quaterniond(matrix).normalized(), sign * t.normalized()};
}

void AddEssentialCandidates(const std::vector<cv::Point2d>& a, const std::vector<cv::Point2d>& b,
                            double threshold, std::vector<Rigid3>& candidates) {
  const cv::Mat essential = cv::findEssentialMat(a, b, cv::Matx33d::eye(), cv::USAC_ACCURATE,
                                                 kConfidence, threshold, kMaxIterations);
  if (essential.rows != 3 || essential.cols != 3) return;
  cv::Mat rotation_1;
  cv::Mat rotation_2;
  cv::Mat translation;
  cv::decomposeEssentialMat(essential, rotation_1, rotation_2, translation);
  for (const cv::Mat& rotation : {rotation_1, rotation_2}) {
    for (const double sign : {1.0, -1.0}) {
      candidates.push_back(MakePose(rotation, translation, sign));
    }
  }
}

void AddHomographyCandidates(const std::vector<cv::Point2d>& a, const std::vector<cv::Point2d>& b,
                             double threshold, std::vector<Rigid3>& candidates) {
  const cv::Mat homography = cv::findHomography(a, b, cv::USAC_ACCURATE, threshold, cv::noArray(),
                                                kMaxIterations, kConfidence);
  if (homography.empty()) return;
  std::vector<cv::Mat> rotations;
  std::vector<cv::Mat> translations;
  std::vector<cv::Mat> normals;
  cv::decomposeHomographyMat(homography, cv::Matx33d::eye(), rotations, translations, normals);
  for (size_t i = 0; i < rotations.size(); ++i) {
    if (cv::norm(translations[i]) < 1e-9) continue;  // A pure rotation has no direction.
    for (const double sign : {1.0, -1.0}) {
      candidates.push_back(MakePose(rotations[i], translations[i], sign));
    }
  }
}

}  // namespace

std::vector<Rigid3> RelativePoseCandidates(std::span<const Eigen::Vector2d> normalized_a,
                                           std::span<const Eigen::Vector2d> normalized_b,
                                           double threshold, uint64_t seed) {
  S3LAM_CHECK(normalized_a.size() == normalized_b.size());
  std::vector<Rigid3> candidates;
  if (normalized_a.size() < 8) return candidates;
  std::vector<cv::Point2d> a;
  std::vector<cv::Point2d> b;
  for (const size_t i : internal::DataOrder(normalized_a.size(), seed)) {
    a.emplace_back(normalized_a[i].x(), normalized_a[i].y());
    b.emplace_back(normalized_b[i].x(), normalized_b[i].y());
  }
  AddEssentialCandidates(a, b, threshold, candidates);
  AddHomographyCandidates(a, b, threshold, candidates);
  std::erase_if(candidates, [](const Rigid3& pose) {
    return !pose.translation.allFinite() || !pose.rotation.coeffs().allFinite();
  });
  return candidates;
}

}  // namespace s3lam
