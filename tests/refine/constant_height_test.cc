// The constant height of a camera above the ground.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "refine/refine_fixture.h"
#include "s3lam/base/options_json.h"
#include "s3lam/optim/self_calibration.h"
#include "s3lam/refine/pipeline.h"
#include "s3lam/synthetic/synthetic_map.h"

namespace s3lam::refine {
namespace {

TEST(RefineCameraHeight, IsFoundAndMadeConstant) {
  const SyntheticMap map = MakeDrive();
  Output output;
  const Report report = refine::Run(Options(), MakeInput(map), output);
  ASSERT_TRUE(report.ground.in_use) << report.ground.reason;
  EXPECT_GT(report.ground.num_planes, 2u);
  EXPECT_LT(report.ground.spread_after, 0.01);
  Output plain;
  refine::Run(WithMode(PlaneMode::kOff), MakeInput(map), plain);
  EXPECT_LT(AlignedCenterError(output.model, map.truth),
            AlignedCenterError(plain.model, map.truth));
}

TEST(RefineCameraHeight, AKnownHeightMakesTheOutputMetric) {
  const SyntheticMap map = MakeDrive();
  Options options;
  Output free;
  const Report report = refine::Run(options, MakeInput(map), free);
  options.camera_height.value = 3.0 * report.ground.height;
  Output metric;
  EXPECT_NEAR(refine::Run(options, MakeInput(map), metric).metres_per_unit, 3.0, 1e-9);
  const auto a = Centers(free.model, map.truth);
  const auto b = Centers(metric.model, map.truth);
  for (size_t i = 0; i < a.size(); ++i) EXPECT_LT((3.0 * a[i] - b[i]).norm(), 1e-9);
  CheckSemanticMap(metric.semantics, metric.model, "metric");
  for (const auto& [id, plane] : metric.semantics.planes) {
    const double distance = free.semantics.planes.at(id).plane_in_world.SignedDistance(a[0]);
    EXPECT_NEAR(plane.plane_in_world.SignedDistance(b[0]), 3.0 * distance, 1e-7);
  }
}

TEST(RefineCameraHeight, SwitchedOffOrWithoutItsClassItIsNotUsed) {
  const SyntheticMap map = MakeDrive();
  for (const char* assignment : {"camera_height.mode=off", "camera_height.class=no such class"}) {
    Options options;
    SetOption(assignment, options);
    Output output;
    EXPECT_FALSE(refine::Run(options, MakeInput(map), output).ground.in_use) << assignment;
  }
}

TEST(RefineCameraHeight, AHandHeldCameraOverATableIsNotAVehicle) {
  const SyntheticMap map = MakeDeskMap();
  Options options;
  options.camera_height.ground_class = "dining table";
  Output output;
  const Report report = refine::Run(options, MakeInput(map), output);
  EXPECT_FALSE(report.ground.in_use);
  EXPECT_FALSE(report.ground.reason.empty());
}

/// The drive along the street with its cameras raised [m] by a function of the part driven.
SyntheticMap MakeRaisedDrive(const std::function<double(double)>& raise,
                             const SyntheticMapOptions& options) {
  Scene scene = MakeScene("street", 1);
  constexpr int kKnots = 60;
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3d> targets;
  const double duration_s = scene.path.duration_s();
  for (int i = 0; i < kKnots; ++i) {
    const double part = i / (kKnots - 1.0);
    const Rigid3 pose = scene.path.WorldFromCamera(part * duration_s);
    positions.push_back(pose.translation + raise(part) * Eigen::Vector3d::UnitZ());
    targets.push_back(positions.back() + pose.rotation * Eigen::Vector3d::UnitZ());
  }
  scene.path = CameraPath(positions, targets, duration_s, {}, 1);
  return MakeSyntheticMap(scene, 1, options);
}

/// A drive that rises slowly above its road, seen too well for the road to bring it down.
SyntheticMap MakeClimb() {
  SyntheticMapOptions options;
  options.num_points = 4000;
  options.pixel_sigma = 0.2;
  return MakeRaisedDrive([](double part) { return part; }, options);
}

TEST(RefineCameraHeight, IsLeftAloneWhereItIsConstantAlready) {
  SyntheticMapOptions map_options;
  map_options.num_points = 4000;
  map_options.pixel_sigma = 0.2;
  const SyntheticMap map = MakeSyntheticMap("street", 1, map_options);
  Options options;
  Output output;
  const Report report = refine::Run(options, MakeInput(map), output);
  EXPECT_FALSE(report.ground.in_use);
  EXPECT_NE(report.ground.reason.find("nothing to mend"), std::string::npos)
      << report.ground.reason;
  options.camera_height.value = 1.65;  // Unless it is to give the scale.
  EXPECT_TRUE(refine::Run(options, MakeInput(map), output).ground.in_use);
}

TEST(RefineCameraHeight, CostsLittleWhereAVehicleSwaysByAPercent) {
  SyntheticMapOptions options;
  options.num_points = 2000;
  options.pixel_sigma = 1.5;
  options.max_track_window = 2;
  constexpr double kHeightM = 1.65;
  const SyntheticMap map =
      MakeRaisedDrive([](double part) { return 0.01 * kHeightM * std::sin(18.0 * part); }, options);
  Output with;
  ASSERT_TRUE(refine::Run(Options(), MakeInput(map), with).ground.in_use);
  Options off;
  off.camera_height.mode = CameraHeightMode::kOff;
  Output without;
  refine::Run(off, MakeInput(map), without);
  EXPECT_LT(AlignedCenterError(with.model, map.truth),
            1.5 * AlignedCenterError(without.model, map.truth));
}

TEST(RefineCameraHeight, WhereTheMapContradictsItTheAdjustmentStartsAgainWithout) {
  const Input input = MakeInput(MakeClimb());
  Options options;
  Output output;
  const Report report = refine::Run(options, input, output);
  EXPECT_GT(report.ground.num_planes, 2u);  // It was tried.
  EXPECT_FALSE(report.ground.in_use);
  EXPECT_NE(report.ground.reason.find("the map does not follow"), std::string::npos)
      << report.ground.reason;
  options.camera_height.mode = CameraHeightMode::kOff;
  Output without;
  refine::Run(options, input, without);
  EXPECT_TRUE(SameBytes(output.model, without.model));
  EXPECT_EQ(output.semantics.planes.size(), without.semantics.planes.size());
}

constexpr double kWrongDistortion = 0.01;

/// The drive along the street as a program sees it that has the camera wrong.
Input MakeDriveWithWrongCamera(const std::function<void(Camera&)>& change, SyntheticMap& map) {
  SyntheticMapOptions options;
  options.num_images = 40;
  options.num_points = 3000;
  options.max_track_window = 2;
  options.pixel_sigma = 0.3;
  map = MakeSyntheticMap("street", 1, options);
  Input input = MakeInput(map);
  change(input.model.cameras.begin()->second);
  return input;
}

Input MakeDriveWithWrongLens(SyntheticMap& map) {
  const auto change = [](Camera& camera) {
    camera = WithDistortion(camera);
    camera.params[4] = kWrongDistortion;
  };
  return MakeDriveWithWrongCamera(change, map);
}

TEST(RefineCameraHeight, TellsTheDistortionThatMakesTheScaleDrift) {
  SyntheticMap map;
  const Input input = MakeDriveWithWrongLens(map);
  Options options;
  Output with_lens;
  const Report report = refine::Run(options, input, with_lens);
  ASSERT_TRUE(report.ground.in_use) << report.ground.reason;
  ASSERT_EQ(report.cameras.size(), 1u);
  EXPECT_TRUE(report.cameras[0].refined);
  EXPECT_FALSE(report.cameras[0].distortion_is_doubtful);
  EXPECT_EQ(report.cameras[0].before[4], kWrongDistortion);
  EXPECT_LT(std::abs(report.cameras[0].after[4]), 0.3 * kWrongDistortion);
  EXPECT_EQ(with_lens.model.cameras.begin()->second.params, report.cameras[0].after);

  options.camera_height.refine_camera = RefinedWithHeights::kNone;
  Output without;
  const Report kept = refine::Run(options, input, without);
  EXPECT_FALSE(kept.cameras.at(0).refined);
  EXPECT_EQ(without.model.cameras.begin()->second.params,
            input.model.cameras.begin()->second.params);
  EXPECT_LT(AlignedCenterError(with_lens.model, map.truth),
            0.5 * AlignedCenterError(without.model, map.truth));
}

TEST(RefineCameraHeight, TellsThePrincipalPointThatMakesTheScaleDrift) {
  constexpr double kShift = 15.0;  // px
  SyntheticMap map;
  const Input input =
      MakeDriveWithWrongCamera([](Camera& camera) { camera.params[2] += kShift; }, map);
  const Camera& given = input.model.cameras.begin()->second;
  Options options;
  Output whole;
  const Report report = refine::Run(options, input, whole);
  ASSERT_TRUE(report.ground.in_use) << report.ground.reason;
  EXPECT_TRUE(report.cameras.at(0).refined);
  EXPECT_TRUE(report.cameras[0].better_pinhole.empty());
  const Camera& found = whole.model.cameras.begin()->second;
  EXPECT_LT(std::abs(found.PrincipalX() - (given.PrincipalX() - kShift)), 0.3 * kShift);

  options.camera_height.refine_camera = RefinedWithHeights::kDistortion;
  Output distortion_only;
  refine::Run(options, input, distortion_only);
  EXPECT_LT(AlignedCenterError(whole.model, map.truth),
            0.5 * AlignedCenterError(distortion_only.model, map.truth));
}

TEST(RefineCameraHeight, RefinesTheDistortionAloneWhereTheRestCannotBeBelieved) {
  SyntheticMap map;
  const Input input = MakeDriveWithWrongLens(map);
  Options options;
  options.intrinsics.max_principal_shift = 0.0;
  Output output;
  const Report report = refine::Run(options, input, output);
  ASSERT_TRUE(report.ground.in_use) << report.ground.reason;
  EXPECT_TRUE(report.cameras.at(0).refined);
  EXPECT_LT(std::abs(report.cameras[0].after[4]), 0.3 * kWrongDistortion);
  const Camera& before = input.model.cameras.begin()->second;
  const Camera& after = output.model.cameras.begin()->second;
  EXPECT_EQ(after.FocalX(), before.FocalX());
  EXPECT_EQ(after.PrincipalX(), before.PrincipalX());
}

TEST(RefineCameraHeight, LeavesTheCameraWhereWhatItTellsCannotBeBelieved) {
  SyntheticMap map;
  const Input input = MakeDriveWithWrongLens(map);
  Options options;
  options.intrinsics.focal_length = true;
  options.intrinsics.max_focal_change = 0.0;
  Output output;
  const Report report = refine::Run(options, input, output);
  EXPECT_TRUE(report.ground.in_use) << report.ground.reason;
  EXPECT_FALSE(report.cameras.at(0).refined);
  EXPECT_EQ(output.model.cameras.begin()->second.params,
            input.model.cameras.begin()->second.params);
}

TEST(RefineCameraHeight, KeepsCamerasThatTooLittleWasTakenWith) {
  SyntheticMap map;
  const Input input = MakeDriveWithWrongLens(map);
  Options options;
  options.intrinsics.min_images = 1000;
  Output too_few;
  const Report report = refine::Run(options, input, too_few);
  EXPECT_TRUE(report.ground.in_use) << report.ground.reason;
  EXPECT_TRUE(report.cameras.empty());
  options.camera_height.refine_camera = RefinedWithHeights::kNone;
  Output kept;
  refine::Run(options, input, kept);
  EXPECT_TRUE(SameBytes(too_few.model, kept.model));
}

}  // namespace
}  // namespace s3lam::refine
