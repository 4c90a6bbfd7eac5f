#include "s3lam/refine/intrinsics.h"

#include <gtest/gtest.h>

#include "refine/refine_fixture.h"
#include "s3lam/base/error.h"
#include "support/test_scene.h"

namespace s3lam::refine {
namespace {

const std::vector<std::string> kPlainWithFocal{"planes.mode=off", "intrinsics.focal_length=true"};

TEST(RefineIntrinsics, ParametersAreChosenByTheirMeaning) {
  IntrinsicsOptions focal;
  focal.focal_length = true;
  IntrinsicsOptions rest;
  rest.principal_point = rest.distortion = true;
  using Params = std::vector<int>;
  EXPECT_EQ(RefinedParams(focal, CameraModel::kSimpleRadial), Params({0}));
  EXPECT_EQ(RefinedParams(focal, CameraModel::kOpenCv), Params({0, 1}));
  EXPECT_EQ(RefinedParams(rest, CameraModel::kSimplePinhole), Params({1, 2}));
  EXPECT_EQ(RefinedParams(rest, CameraModel::kFov), Params({2, 3, 4}));
  EXPECT_EQ(RefinedParams(rest, CameraModel::kFullOpenCv), Params({2, 3, 4, 5, 8}));
  rest.tangential = true;
  EXPECT_EQ(RefinedParams(rest, CameraModel::kFullOpenCv),
            Params({2, 3, 4, 5, 6, 7, 8, 9, 10, 11}));
  EXPECT_TRUE(RefinedParams({}, CameraModel::kOpenCv).empty());
}

TEST(RefineIntrinsics, AWrongFocalLengthIsFoundAndTheRestStays) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  Camera& camera = input.model.cameras.begin()->second;
  const std::vector<double> truth = camera.params;
  camera.params[0] *= 1.02;
  if (!CameraModelHasSingleFocal(camera.model)) camera.params[1] *= 1.02;
  Output kept;
  Output output;
  refine::Run(MakeOptions({"planes.mode=off"}), input, kept);
  const Report report = refine::Run(MakeOptions(kPlainWithFocal), input, output);
  EXPECT_EQ(kept.model.cameras.begin()->second.params, camera.params);
  const Camera& refined = output.model.cameras.begin()->second;
  EXPECT_NEAR(refined.FocalX() / truth[0], 1.0, 2e-3);
  EXPECT_EQ(refined.PrincipalX(), camera.PrincipalX());
  EXPECT_EQ(refined.PrincipalY(), camera.PrincipalY());
  ASSERT_EQ(report.cameras.size(), 1u);
  EXPECT_TRUE(report.cameras[0].refined);
  EXPECT_EQ(report.cameras[0].before, camera.params);
  EXPECT_EQ(report.cameras[0].after, refined.params);
  // Each arm is judged with its own camera.
  EXPECT_LT(report.arms[1].reprojection_rms_px, 0.9 * report.arms[0].reprojection_rms_px);
  EXPECT_LT(AlignedCenterError(output.model, map.truth), AlignedCenterError(kept.model, map.truth));
}

TEST(RefineIntrinsics, AChangeBeyondBeliefIsRefused) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  Camera& camera = input.model.cameras.begin()->second;
  camera.params[0] *= 1.05;
  if (!CameraModelHasSingleFocal(camera.model)) camera.params[1] *= 1.05;
  std::vector<std::string> assignments = kPlainWithFocal;
  assignments.push_back("intrinsics.max_focal_change=0.01");
  Output output;
  Output kept;
  const Report report = refine::Run(MakeOptions(assignments), input, output);
  refine::Run(MakeOptions({"planes.mode=off"}), input, kept);
  ASSERT_EQ(report.cameras.size(), 1u);
  EXPECT_FALSE(report.cameras[0].refined);
  EXPECT_NE(report.cameras[0].reason.find("focal length"), std::string::npos);
  EXPECT_NE(report.cameras[0].reason.find("max_focal_change can be raised"), std::string::npos);
  EXPECT_EQ(output.model.cameras.begin()->second.params, camera.params);
  for (const auto& [id, image] : output.model.images) {
    EXPECT_EQ(image.cam_from_world.translation,
              kept.model.images.at(id).cam_from_world.translation);
  }
}

/// Four cameras took turns; the given focal length of the last one is far off, the others' a
/// little.
Input WithOneBadCamera(const SyntheticMap& map) {
  Input input = MakeInput(map);
  const Camera right = input.model.cameras.begin()->second;
  input.model.cameras.clear();
  for (uint32_t c = 10; c < 20; ++c) {
    Camera camera = right;
    camera.id = CameraId(c);
    camera.params[0] *= c == 19 ? 0.8 : 1.02;
    camera.params[1] *= c == 19 ? 0.8 : 1.02;
    input.model.cameras[camera.id] = camera;
  }
  for (auto& [id, image] : input.model.images) image.camera_id = CameraId(10 + id.value() % 10);
  return input;
}

TEST(RefineIntrinsics, OnlyTheCameraThatIsBeyondBeliefIsKept) {
  const SyntheticMap map = MakeDeskMap({"num_images=40", "num_points=300", "max_track_window=0"});
  const double focal = map.truth.cameras.begin()->second.FocalX();
  const Input input = WithOneBadCamera(map);
  auto assignments = kPlainWithFocal;
  assignments.insert(assignments.end(),
                     {"intrinsics.min_images=4", "intrinsics.min_observations=100"});
  Output kept;
  Output output;
  refine::Run(MakeOptions({"planes.mode=off"}), input, kept);
  const Report report = refine::Run(MakeOptions(assignments), input, output);
  ASSERT_EQ(report.cameras.size(), 10u);
  for (const IntrinsicsReport& camera : report.cameras) {
    const CameraId id = camera.cameras.front();
    const bool is_bad = id == CameraId(19);
    EXPECT_EQ(camera.refined, !is_bad) << camera.reason;
    EXPECT_EQ(camera.reason.find("focal length") != std::string::npos, is_bad);
    EXPECT_EQ(camera.after, output.model.cameras.at(id).params);
    EXPECT_EQ(camera.after == input.model.cameras.at(id).params, is_bad);
    EXPECT_NEAR(camera.after[0], (is_bad ? 0.8 : 1.0) * focal, 0.015 * focal);
  }
  EXPECT_LT(AlignedCenterError(output.model, map.truth), AlignedCenterError(kept.model, map.truth));
}

TEST(RefineIntrinsics, CamerasThatAreOneAreKeptTogetherAsTheyWereGiven) {
  const SyntheticMap map = MakeDeskMap({"num_images=40", "num_points=300", "max_track_window=0"});
  const Input input = WithOneBadCamera(map);
  auto assignments = kPlainWithFocal;
  assignments.insert(assignments.end(),
                     {"intrinsics.shared=true", "intrinsics.max_focal_change=0.001"});
  Output output;
  const Report report = refine::Run(MakeOptions(assignments), input, output);
  EXPECT_EQ(report.cameras.size(), 10u);
  for (const auto& [id, camera] : input.model.cameras) {
    EXPECT_EQ(output.model.cameras.at(id).params, camera.params);
  }
}

/// Every second image gets a camera of its own, with the same parameters.
Input WithTwoCameras(const SyntheticMap& map) {
  Input input = MakeInput(map);
  Camera second = input.model.cameras.begin()->second;
  second.id = CameraId(50);
  input.model.cameras[second.id] = second;
  for (auto& [id, image] : input.model.images) {
    if (id.value() % 2 == 0) image.camera_id = second.id;
  }
  for (auto& [id, camera] : input.model.cameras) camera.params[0] *= 1.01;
  return input;
}

TEST(RefineIntrinsics, CamerasAreRefinedApartTogetherOrByChoice) {
  const SyntheticMap map = MakeDeskMap();
  const Input input = WithTwoCameras(map);
  const CameraId first = input.model.cameras.begin()->first;
  const CameraId second(50);
  Output apart;
  EXPECT_EQ(refine::Run(MakeOptions(kPlainWithFocal), input, apart).cameras.size(), 2u);
  EXPECT_NE(apart.model.cameras.at(first).params, apart.model.cameras.at(second).params);
  auto assignments = kPlainWithFocal;
  assignments.push_back("intrinsics.shared=true");
  Output shared;
  const Report report = refine::Run(MakeOptions(assignments), input, shared);
  ASSERT_EQ(report.cameras.size(), 1u);
  EXPECT_EQ(report.cameras[0].cameras, std::vector<CameraId>({first, second}));
  EXPECT_EQ(shared.model.cameras.at(first).params, shared.model.cameras.at(second).params);
  EXPECT_NE(shared.model.cameras.at(first).params, input.model.cameras.at(first).params);
  assignments = kPlainWithFocal;
  assignments.push_back(R"(intrinsics.cameras=["50"])");
  Output chosen;
  refine::Run(MakeOptions(assignments), input, chosen);
  EXPECT_EQ(chosen.model.cameras.at(first).params, input.model.cameras.at(first).params);
  EXPECT_NE(chosen.model.cameras.at(second).params, input.model.cameras.at(second).params);
  assignments.back() = R"(intrinsics.cameras=["51"])";
  EXPECT_THROW(refine::Run(MakeOptions(assignments), input, chosen), InputError);
}

TEST(RefineIntrinsics, CamerasThatAreKeptAreSharedWithNone) {
  const SyntheticMap map = MakeDeskMap();
  Input input = WithTwoCameras(map);
  const CameraId first = input.model.cameras.begin()->first;
  const CameraId second(50);
  input.model.cameras.at(second).params[0] *= 1.002;
  auto assignments = kPlainWithFocal;
  assignments.push_back("intrinsics.shared=true");
  for (const char* chosen : {R"(intrinsics.cameras=["50"])", "intrinsics.min_images=17"}) {
    auto with_choice = assignments;
    with_choice.emplace_back(chosen);
    Output output;
    const Report report = refine::Run(MakeOptions(with_choice), input, output);
    EXPECT_EQ(output.model.cameras.at(first).params, input.model.cameras.at(first).params)
        << chosen;
    EXPECT_EQ(report.cameras.size(), 2u);
    EXPECT_FALSE(report.cameras[0].refined);
  }
}

TEST(RefineIntrinsics, ACameraThatHardlyAnythingWasTakenWithIsKept) {
  const SyntheticMap map = MakeDeskMap();
  auto assignments = kPlainWithFocal;
  assignments.push_back("intrinsics.min_images=17");
  Output output;
  const Report report = refine::Run(MakeOptions(assignments), MakeInput(map), output);
  ASSERT_EQ(report.cameras.size(), 1u);
  EXPECT_FALSE(report.cameras[0].refined);
  EXPECT_NE(report.cameras[0].reason.find("only 16 images"), std::string::npos);
  EXPECT_EQ(output.model.cameras.begin()->second.params,
            map.estimate.cameras.begin()->second.params);
}

/// Every image has a camera of its own.
TEST(RefineIntrinsics, OneImageIsEnoughOnRequestAndManyCamerasAreCounted) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  const Camera right = input.model.cameras.begin()->second;
  input.model.cameras.clear();
  for (auto& [id, image] : input.model.images) {
    image.camera_id = CameraId(id.value());
    Camera& camera = input.model.cameras[image.camera_id] = right;
    camera.id = image.camera_id;
    camera.params[0] *= 1.02;
    if (!CameraModelHasSingleFocal(camera.model)) camera.params[1] *= 1.02;
  }
  auto assignments = kPlainWithFocal;
  assignments.emplace_back("intrinsics.min_observations=10");
  Output kept;
  const Report kept_report = refine::Run(MakeOptions(assignments), input, kept);
  for (const IntrinsicsReport& camera : kept_report.cameras) EXPECT_FALSE(camera.refined);
  assignments.emplace_back("intrinsics.min_images=1");
  Output output;
  const Report report = refine::Run(MakeOptions(assignments), input, output);
  ASSERT_EQ(report.cameras.size(), 16u);
  for (const IntrinsicsReport& camera : report.cameras) EXPECT_TRUE(camera.refined);
  EXPECT_LT(AlignedCenterError(output.model, map.truth), AlignedCenterError(kept.model, map.truth));
  for (const Report* many : {&kept_report, &report}) {
    const std::string table = ToTable(*many);
    EXPECT_NE(table.find("\ncamera 10 "), std::string::npos) << table;
    EXPECT_EQ(table.find("\ncamera 11 "), std::string::npos) << table;
    EXPECT_NE(table.find("6 more cameras like these"), std::string::npos) << table;
  }
}

/// Whose keypoints tell also what is a little wrong with its camera.
SyntheticMap MakePreciseMap(const std::string& scene) {
  SyntheticMapOptions options;
  options.num_images = 16;
  options.num_points = 1500;
  options.pixel_sigma = 0.2;
  return MakeSyntheticMap(scene, 3, options);
}

/// Images with a little distortion that the model, a pinhole camera, does not know of.
Input WithUnknownDistortion(const SyntheticMap& map) {
  Input input = MakeInput(map);
  Camera& camera = input.model.cameras.begin()->second;
  Camera distorted = camera;
  distorted.model = CameraModel::kOpenCv;
  distorted.params = {camera.FocalX(),
                      camera.FocalY(),
                      camera.PrincipalX(),
                      camera.PrincipalY(),
                      0.02,
                      0.0,
                      -0.001,
                      0.0};
  for (auto& [id, image] : input.model.images) {
    for (Point2D& point2D : image.points2D) {
      const auto ray = camera.CameraFromImage(point2D.xy);
      point2D.xy = *distorted.ImageFromCamera(ray->homogeneous());
    }
  }
  camera.model = CameraModel::kPinhole;
  camera.params.resize(4);
  return input;
}

TEST(RefineIntrinsics, ADistortionThatTheModelLacksIsToldAndRefinedIfWanted) {
  const SyntheticMap map = MakePreciseMap("street");
  ASSERT_EQ(map.estimate.cameras.begin()->second.model, CameraModel::kPinhole);
  const Input input = WithUnknownDistortion(map);
  Output kept;
  const Report told = refine::Run(MakeOptions({"planes.mode=off"}), input, kept);
  ASSERT_EQ(told.cameras.size(), 1u);
  EXPECT_TRUE(told.cameras[0].distortion_is_doubtful);
  EXPECT_GT(told.cameras[0].distortion_cost_share, 0.1);
  EXPECT_FALSE(told.cameras[0].refined);
  EXPECT_EQ(kept.model.cameras.begin()->second.model, CameraModel::kPinhole);
  EXPECT_NE(ToTable(told).find("another lens distortion"), std::string::npos);
  EXPECT_EQ(ToJson(told)["cameras"][0]["distortion_is_doubtful"], true);
  Output refined;
  const Report report = refine::Run(
      MakeOptions({"planes.mode=off", "intrinsics.distortion=true", "intrinsics.tangential=true"}),
      input, refined);
  ASSERT_EQ(report.cameras.size(), 1u);
  EXPECT_TRUE(report.cameras[0].refined) << report.cameras[0].reason;
  EXPECT_EQ(report.cameras[0].model_after, "OPENCV");
  const Camera& camera = refined.model.cameras.begin()->second;
  ASSERT_EQ(camera.model, CameraModel::kOpenCv);
  EXPECT_NEAR(camera.params[4], 0.02, 0.005);
  EXPECT_NEAR(camera.params[6], -0.001, 0.0005);
  EXPECT_LT(AlignedCenterError(refined.model, map.truth),
            0.5 * AlignedCenterError(kept.model, map.truth));
}

TEST(RefineIntrinsics, CamerasThatAreKeptBesideRefinedOnesAreCheckedToo) {
  Input input = WithUnknownDistortion(MakePreciseMap("street"));
  const CameraId kept = input.model.cameras.begin()->first;
  Camera refined = input.model.cameras.at(kept);
  refined.id = CameraId(50);
  input.model.cameras[refined.id] = refined;
  for (auto& [id, image] : input.model.images) {
    if (id.value() % 2 == 0) image.camera_id = refined.id;
  }
  Output output;
  const Report report = refine::Run(MakeOptions({"planes.mode=off", "intrinsics.distortion=true",
                                                 R"(intrinsics.cameras=["50"])"}),
                                    input, output);
  ASSERT_EQ(report.cameras.size(), 2u);
  EXPECT_FALSE(report.cameras[0].refined);
  EXPECT_TRUE(report.cameras[0].distortion_is_doubtful);
  EXPECT_TRUE(report.cameras[1].refined);
  EXPECT_EQ(report.cameras[1].distortion_cost_share, 0.0);
  EXPECT_NE(ToTable(report).find("kept, not asked for, but another lens distortion"),
            std::string::npos);
}

TEST(RefineIntrinsics, AWrongPrincipalPointIsToldAndRefinedIfWanted) {
  const SyntheticMap map = MakePreciseMap("desk");
  Input input = MakeInput(map);
  Camera& camera = input.model.cameras.begin()->second;
  const double right = camera.PrincipalX();
  const size_t index = CameraModelHasSingleFocal(camera.model) ? 1 : 2;
  camera.params[index] += 10.0;
  Output kept;
  const Report told = refine::Run(MakeOptions({"planes.mode=off"}), input, kept);
  ASSERT_EQ(told.cameras.size(), 1u);
  EXPECT_FALSE(told.cameras[0].refined);
  EXPECT_EQ(told.cameras[0].after[index], right + 10.0);
  ASSERT_EQ(told.cameras[0].better_pinhole.size(), 4u);
  EXPECT_NEAR(told.cameras[0].better_pinhole[2], right, 1.0);
  EXPECT_NE(ToTable(told).find("principal point of"), std::string::npos);
  Output refined;
  refine::Run(MakeOptions({"planes.mode=off", "intrinsics.focal_length=true",
                           "intrinsics.principal_point=true"}),
              input, refined);
  EXPECT_NEAR(refined.model.cameras.begin()->second.PrincipalX(), right, 1.0);
  EXPECT_LT(AlignedCenterError(refined.model, map.truth),
            0.5 * AlignedCenterError(kept.model, map.truth));
}

TEST(RefineIntrinsics, ARightCalibrationIsNotSpokenOf) {
  const SyntheticMap map = MakeDeskMap();
  Output output;
  const Report report = refine::Run(MakeOptions({"planes.mode=off"}), MakeInput(map), output);
  ASSERT_EQ(report.cameras.size(), 1u);
  EXPECT_FALSE(report.cameras[0].distortion_is_doubtful);
  EXPECT_EQ(ToTable(report).find("distortion"), std::string::npos);
  EXPECT_EQ(ToJson(report)["cameras"][0]["distortion_is_doubtful"], false);
  EXPECT_TRUE(report.cameras[0].better_pinhole.empty());
  const Report unchecked = refine::Run(MakeOptions({"planes.mode=off", "intrinsics.check=false"}),
                                       MakeInput(map), output);
  EXPECT_TRUE(unchecked.cameras.empty());
}

TEST(RefineIntrinsics, DoubtsNameWhatIsWrong) {
  const IntrinsicsOptions options;
  const Camera before = testing::MakeTestCamera(CameraModel::kSimpleRadial);
  EXPECT_EQ(DoubtsAboutCamera(options, before, before), "");
  Camera after = before;
  after.params[0] = -500.0;
  EXPECT_NE(DoubtsAboutCamera(options, before, after).find("focal length"), std::string::npos);
  after = before;
  after.params[1] += 100.0;
  EXPECT_NE(DoubtsAboutCamera(options, before, after).find("principal point"), std::string::npos);
  after = before;
  after.params[3] = -0.9;  // Folds back within the image.
  EXPECT_NE(DoubtsAboutCamera(options, before, after).find("distortion"), std::string::npos);
}

}  // namespace
}  // namespace s3lam::refine
