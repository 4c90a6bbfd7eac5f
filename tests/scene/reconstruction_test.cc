#include "s3lam/scene/reconstruction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "s3lam/base/error.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::MakeTestScene;
using ::testing::ThrowsMessage;

TEST(CheckReconstruction, AcceptsAConsistentOne) {
  const Reconstruction scene = MakeTestScene({.num_cameras = 3});
  CheckReconstruction(scene, "model");
  EXPECT_EQ(scene.cameras.size(), 3u);
  EXPECT_GT(scene.NumObservations(), 100u);
  CheckReconstruction(Reconstruction(), "empty");
}

struct Fault {
  const char* name;
  const char* message;
  std::function<void(Reconstruction&)> make;
};

const double kNan = std::numeric_limits<double>::quiet_NaN();

Image& FirstImage(Reconstruction& r) { return r.images.begin()->second; }
ScenePoint& FirstPoint(Reconstruction& r) { return r.points.begin()->second; }
Point2D& FirstObservation(Reconstruction& r) {
  const TrackElement& element = FirstPoint(r).track[0];
  return r.images.at(element.image_id).points2D[element.point2D_index];
}

const Fault kFaults[] = {
    {"CameraParameters", "parameters", [](auto& r) { r.cameras.begin()->second.params.clear(); }},
    {"UnknownCamera", "unknown camera 99", [](auto& r) { FirstImage(r).camera_id = CameraId(99); }},
    {"PoseNotFinite", "not finite",
     [](auto& r) { FirstImage(r).cam_from_world.translation.x() = kNan; }},
    {"RotationNotUnit", "quaternion of norm",
     [](auto& r) { FirstImage(r).cam_from_world.rotation.coeffs() *= 1.1; }},
    {"KeypointNotFinite", "keypoint 0 is not finite",
     [](auto& r) { FirstImage(r).points2D[0].xy.x() = kNan; }},
    {"UnknownPoint", "point 5555, which does not exist",
     [](auto& r) { FirstImage(r).points2D.back().point_id = PointId(5555); }},
    {"PointNotFinite", "is not finite", [](auto& r) { FirstPoint(r).xyz.z() = kNan; }},
    {"TrackImageUnknown", "image 777, which does not exist",
     [](auto& r) { FirstPoint(r).track[0].image_id = ImageId(777); }},
    {"TrackIndexTooLarge", "refers to keypoint 100000",
     [](auto& r) { FirstPoint(r).track[0].point2D_index = 100000; }},
    {"TrackWithoutKeypoint", "do not refer to each other",
     [](auto& r) { FirstObservation(r).point_id = kInvalidPointId; }},
    {"KeypointOfAnotherPoint", "do not refer to each other",
     [](auto& r) { FirstObservation(r).point_id = r.points.rbegin()->first; }},
    {"KeypointWithoutTrack", "does not have it in its track",
     [](auto& r) { FirstPoint(r).track.pop_back(); }},
    {"TrackElementTwice", "is twice in the track",
     [](auto& r) { FirstPoint(r).track.push_back(FirstPoint(r).track[0]); }},
};

class CheckReconstructionFault : public ::testing::TestWithParam<Fault> {};

TEST_P(CheckReconstructionFault, IsNamed) {
  Reconstruction scene = MakeTestScene();
  GetParam().make(scene);
  EXPECT_THAT(
      [&] { CheckReconstruction(scene, "my model"); },
      ThrowsMessage<InputError>(AllOf(HasSubstr("my model"), HasSubstr(GetParam().message))));
}

INSTANTIATE_TEST_SUITE_P(Faults, CheckReconstructionFault, ::testing::ValuesIn(kFaults),
                         [](const auto& fault) { return std::string(fault.param.name); });

TEST(ReprojectionStatistics, AreZeroWithoutNoiseAndMeasureIt) {
  Reconstruction exact = MakeTestScene({.noise_px = 0.0, .model = CameraModel::kOpenCv});
  EXPECT_LT(ComputeReprojectionStatistics(exact).rms_px, 1e-9);

  const Reconstruction noisy = MakeTestScene({.num_points = 500, .noise_px = 0.5});
  const ReprojectionStatistics statistics = ComputeReprojectionStatistics(noisy);
  EXPECT_EQ(statistics.num_observations, noisy.NumObservations());
  EXPECT_EQ(statistics.num_behind, 0u);
  // Two coordinates with sigma 0.5 px; the mean length of such a vector is sigma * sqrt(pi/2).
  EXPECT_NEAR(statistics.rms_px, 0.5 * std::sqrt(2.0), 0.03);
  EXPECT_NEAR(statistics.mean_px, 0.5 * std::sqrt(std::numbers::pi / 2.0), 0.03);
}

TEST(ReprojectionStatistics, CountWhatLiesBehind) {
  Reconstruction scene = MakeTestScene({.num_points = 20});
  ScenePoint& point = FirstPoint(scene);
  const size_t track_length = point.track.size();
  point.xyz = Eigen::Vector3d(100.0, 100.0, 0.0);  // Behind all cameras, which look inwards.
  const ReprojectionStatistics statistics = ComputeReprojectionStatistics(scene);
  EXPECT_EQ(statistics.num_behind, track_length);
  EXPECT_EQ(statistics.num_observations, scene.NumObservations() - track_length);
  UpdatePointErrors(scene);
  EXPECT_DOUBLE_EQ(point.error, 800.0);  // The diagonal of 640 x 480.
}

TEST(UpdatePointErrors, SetsMeanDistances) {
  Reconstruction scene = MakeTestScene({.noise_px = 0.0});
  ScenePoint& point = FirstPoint(scene);
  FirstObservation(scene).xy += Eigen::Vector2d(3.0, 4.0);
  UpdatePointErrors(scene);
  EXPECT_NEAR(point.error, 5.0 / static_cast<double>(point.track.size()), 1e-9);
  EXPECT_LT(scene.points.rbegin()->second.error, 1e-9);
}

TEST(TransformReconstruction, KeepsReprojectionsAndScalesDepths) {
  Reconstruction scene = MakeTestScene({.model = CameraModel::kRadial});
  const double rms_px = ComputeReprojectionStatistics(scene).rms_px;
  const double depth = MedianDepth(scene);
  EXPECT_GT(depth, 2.0);
  EXPECT_LT(depth, 6.0);
  const Similarity3 new_from_old{
      2.5, QuaternionFromRotationVector({0.3, -1.0, 2.0}), {5.0, -3.0, 1.0}};
  TransformReconstruction(new_from_old, scene);
  EXPECT_NEAR(ComputeReprojectionStatistics(scene).rms_px, rms_px, 1e-9);
  EXPECT_NEAR(MedianDepth(scene), 2.5 * depth, 1e-9);
  CheckReconstruction(scene, "moved");
}

TEST(MedianDepth, IsZeroOfNothing) { EXPECT_EQ(MedianDepth(Reconstruction()), 0.0); }

TEST(TestScene, IsDeterministicAndFollowsItsOptions) {
  EXPECT_TRUE(testing::Identical(MakeTestScene(), MakeTestScene()));
  EXPECT_FALSE(testing::Identical(MakeTestScene(), MakeTestScene({.seed = 2})));
  const Reconstruction planar = MakeTestScene({.planar = true});
  for (const auto& [id, point] : planar.points) EXPECT_EQ(point.xyz.z(), 0.0);
  Reconstruction moved = MakeTestScene();
  testing::PerturbScene({.rotation_rad = 0.01, .translation = 0.02, .point = 0.03}, moved);
  CheckReconstruction(moved, "perturbed");
  EXPECT_GT(ComputeReprojectionStatistics(moved).rms_px, 2.0);
}

}  // namespace
}  // namespace s3lam
