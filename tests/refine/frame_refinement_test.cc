#include "s3lam/refine/frame_refinement.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// A true map, frames that see its points with half a pixel of noise, and where they really are.
struct Scene {
  Reconstruction map;
  FrameObservations observed;
  Trajectory truth;
  Trajectory disturbed;
};

Scene MakeScene(CameraModel model) {
  Scene scene;
  scene.map =
      testing::MakeTestScene({.num_images = 6, .num_points = 200, .noise_px = 0.0, .model = model});
  Rng rng(3);
  double time = 1.0;
  for (const auto& [id, image] : scene.map.images) {
    ObservedFrame frame;
    frame.time_s = time;
    frame.camera_id = image.camera_id;
    for (const Point2D& point2D : image.points2D) {
      if (!point2D.point_id.valid()) continue;
      const Eigen::Vector2d noise(rng.Gaussian() * 0.5, rng.Gaussian() * 0.5);
      frame.observations.push_back({point2D.point_id, (point2D.xy + noise).cast<float>(), 0.5F});
    }
    scene.observed.push_back(frame);
    const Rigid3 pose = image.cam_from_world.Inverse();
    scene.truth.push_back({time, pose});
    const Eigen::Vector3d turn(0.01 * rng.Gaussian(), 0.01 * rng.Gaussian(), 0.01 * rng.Gaussian());
    const Eigen::Vector3d shift(0.03 * rng.Gaussian(), 0.03 * rng.Gaussian(),
                                0.03 * rng.Gaussian());
    scene.disturbed.push_back({time,
                               {(QuaternionFromRotationVector(turn) * pose.rotation).normalized(),
                                pose.translation + shift}});
    time += 0.25;
  }
  return scene;
}

double Error(const Trajectory& frames, const Trajectory& truth) {
  double sum = 0.0;
  for (size_t i = 0; i < frames.size(); ++i) {
    sum += (frames[i].world_from_camera.translation - truth[i].world_from_camera.translation)
               .squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(frames.size()));
}

TEST(FrameRefinement, FindsTheTruthWithEveryCameraModel) {
  for (int i = 0; i < kNumCameraModels; ++i) {
    const Scene scene = MakeScene(static_cast<CameraModel>(i));
    Trajectory frames = scene.disturbed;
    const auto report = RefineFrames({}, scene.map, scene.observed, 1, frames);
    EXPECT_EQ(report.num_frames, frames.size());
    EXPECT_EQ(report.num_refined, frames.size()) << i;
    EXPECT_LT(Error(frames, scene.truth), 0.1 * Error(scene.disturbed, scene.truth)) << i;
  }
}

TEST(FrameRefinement, IsTheSameForAnyNumberOfThreads) {
  const Scene scene = MakeScene(CameraModel::kOpenCv);
  Trajectory one = scene.disturbed;
  Trajectory four = scene.disturbed;
  RefineFrames({}, scene.map, scene.observed, 1, one);
  RefineFrames({}, scene.map, scene.observed, 4, four);
  for (size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].world_from_camera.translation, four[i].world_from_camera.translation);
    EXPECT_EQ(one[i].world_from_camera.rotation.coeffs(),
              four[i].world_from_camera.rotation.coeffs());
  }
}

TEST(FrameRefinement, FramesThatSeeTooLittleOrSwitchedOffStay) {
  Scene scene = MakeScene(CameraModel::kSimpleRadial);
  scene.observed[0].observations.resize(5);
  // Most of what this one claims to see is wrong.
  for (size_t k = 0; 3 * k < 2 * scene.observed[1].observations.size(); ++k) {
    scene.observed[1].observations[k].xy +=
        Eigen::Vector2f(40.0F + 3.0F * static_cast<float>(k), 0);
  }
  Trajectory frames = scene.disturbed;
  EXPECT_EQ(RefineFrames({}, scene.map, scene.observed, 1, frames).num_refined, frames.size() - 2);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(frames[i].world_from_camera.translation,
              scene.disturbed[i].world_from_camera.translation);
  }
  FrameRefinementOptions off;
  off.enabled = false;
  frames = scene.disturbed;
  EXPECT_EQ(RefineFrames(off, scene.map, scene.observed, 1, frames).num_refined, 0u);
  EXPECT_EQ(Error(frames, scene.disturbed), 0.0);
}

TEST(FrameRefinement, ObservationsMustBelongToTheModel) {
  const Scene scene = MakeScene(CameraModel::kPinhole);
  CheckFrameObservations(scene.observed, scene.map, scene.truth, "file");
  const auto expect_error = [&](const FrameObservations& observed, const std::string& message) {
    EXPECT_THAT([&] { CheckFrameObservations(observed, scene.map, scene.truth, "file"); },
                ThrowsMessage<InputError>(HasSubstr(message)));
  };
  FrameObservations wrong = scene.observed;
  wrong[1].camera_id = CameraId(99);
  expect_error(wrong, "file: the frame at 1.25 s is of camera 99");
  wrong = scene.observed;
  wrong[2].time_s += 0.01;
  expect_error(wrong, "not in frames.txt");
  wrong = scene.observed;
  wrong[0].observations[3].point_id = PointId(123456);
  expect_error(wrong, "sees point 123456");
}

TEST(FrameRefinement, PointsThatAreGoneAreForgotten) {
  const Scene scene = MakeScene(CameraModel::kPinhole);
  Reconstruction less = scene.map;
  const PointId gone = scene.observed[0].observations[0].point_id;
  less.points.erase(gone);
  const FrameObservations kept = KeepKnownPoints(scene.observed, less);
  ASSERT_EQ(kept.size(), scene.observed.size());
  EXPECT_EQ(kept[0].observations.size() + 1, scene.observed[0].observations.size());
  CheckFrameObservations(kept, less, scene.truth, "file");
}

TEST(FrameRefinement, ObservationsFollowPointsThatWereMerged) {
  FrameObservations observed(2);
  observed[0] = {0.0, CameraId(1), {{PointId(1), {1, 1}, 1}, {PointId(3), {3, 3}, 1}}};
  observed[1] = {1.0, CameraId(1), {{PointId(1), {1, 1}, 1}, {PointId(2), {2, 2}, 1}}};
  // 1 has become 2, and 2 has become 4.
  const FrameObservations followed =
      FollowMergedPoints(observed, {{PointId(1), PointId(2)}, {PointId(2), PointId(4)}});
  ASSERT_EQ(followed[0].observations.size(), 2u);
  EXPECT_EQ(followed[0].observations[0].point_id, PointId(4));
  EXPECT_EQ(followed[0].observations[1].point_id, PointId(3));
  ASSERT_EQ(followed[1].observations.size(), 1u);  // It saw both at different places.
  EXPECT_EQ(followed[1].observations[0].point_id, PointId(4));
}

}  // namespace
}  // namespace s3lam
