#include "s3lam/slam/focal_search.h"

#include <gtest/gtest.h>

#include <cmath>

#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

constexpr double kGuess = 450.0;  // px
constexpr int kFrames = 24;

Camera MakeRadial(double focal) {
  Camera camera = testing::MakeTestCamera(CameraModel::kRadial);
  camera.params = {focal, 0.5 * camera.width, 0.5 * camera.height, 0.0, 0.0};
  return camera;
}

CameraRefinement MakeRefinement(double focal, double sigma) {
  CameraRefinement refinement;
  refinement.camera = MakeRadial(focal);
  refinement.focal_sigma = sigma;
  return refinement;
}

TEST(IsBelievable, WhatIsSureOrNearToWhatWasKnown) {
  const FocalPrior prior{kGuess, 0.5};
  EXPECT_TRUE(IsBelievable(MakeRefinement(500.0, 5.0), prior));
  EXPECT_TRUE(IsBelievable(MakeRefinement(700.0, 250.0), prior));   // As by a straight motion.
  EXPECT_TRUE(IsBelievable(MakeRefinement(2500.0, 250.0), prior));  // A tele lens.
  EXPECT_FALSE(IsBelievable(MakeRefinement(19000.0, 6000.0), prior));
  EXPECT_FALSE(IsBelievable(MakeRefinement(40.0, 10.0), prior));
}

/// What a camera sees on an arc around a cloud of points that fills its image, from as far away as
/// it must be for that, turned by `step` from frame to frame.
std::vector<FrameFeatures> SeeFromArc(const Camera& truth, double step,
                                      const Undistorter& undistorter) {
  const testing::PointCloud cloud = testing::MakeCloud(600, /*planar=*/false, 5);
  const Eigen::Vector3d centre(0.0, 0.0, 4.75);
  const Undistorter exact(truth);
  Rng rng(6);
  std::vector<FrameFeatures> frames;
  for (int i = 0; i < kFrames; ++i) {
    const double angle = step * i;
    Rigid3 pose;
    pose.rotation = Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitY()) *
                    Eigen::AngleAxisd(0.2 * std::sin(3.0 * angle), Eigen::Vector3d::UnitX());
    pose.translation = Eigen::Vector3d(0.0, 0.0, truth.FocalX() / 90.0) - pose.rotation * centre;
    frames.push_back(testing::SeeCloud(cloud, pose, exact, 0.3, rng));
    frames.back().Undistort(undistorter);
  }
  return frames;
}

std::optional<CameraRefinement> Search(double true_focal, double step, const FocalPrior& prior) {
  const Camera guess = MakeRadial(prior.focal);
  const auto frames = SeeFromArc(MakeRadial(true_focal), step, Undistorter(guess));
  return SearchFocal({}, frames, Vocabulary({}, frames), guess, prior);
}

TEST(SearchFocal, FindsWhatIsNearToTheGuess) {
  const auto found = Search(500.0, 0.03, {kGuess, 0.5});
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->camera.FocalX(), 500.0, 2.0 * found->focal_sigma);
}

/// Seen from very far away, all that is sure is that the focal length is large.
TEST(SearchFocal, GivesNothingThatCannotBeBelieved) {
  const FocalPrior prior{kGuess, 0.5};
  const auto found = Search(50000.0, 0.015, prior);
  EXPECT_TRUE(!found || IsBelievable(*found, prior)) << found->camera.FocalX();
}

}  // namespace
}  // namespace s3lam
