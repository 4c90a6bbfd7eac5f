#include "s3lam/refine/pipeline.h"

#include <gtest/gtest.h>

#include "refine/refine_fixture.h"
#include "s3lam/base/error.h"
#include "s3lam/base/options_json.h"
#include "s3lam/base/rng.h"
#include "s3lam/geometry/alignment.h"
#include "s3lam/synthetic/synthetic_map.h"

namespace s3lam::refine {
namespace {

Options WithMode(PlaneMode mode) {
  Options options;
  options.planes.mode = mode;
  return options;
}

/// Camera centres of the images that `reference` has.
std::vector<Eigen::Vector3d> Centers(const Reconstruction& model, const Reconstruction& reference) {
  std::vector<Eigen::Vector3d> centers;
  for (const auto& [id, image] : reference.images) {
    centers.push_back(model.images.at(id).cam_from_world.CenterInB());
  }
  return centers;
}

bool SameBytes(const Reconstruction& a, const Reconstruction& b) {
  if (a.points.size() != b.points.size() || a.images.size() != b.images.size()) return false;
  for (const auto& [id, image] : a.images) {
    const Rigid3& other = b.images.at(id).cam_from_world;
    if (image.cam_from_world.rotation.coeffs() != other.rotation.coeffs()) return false;
    if (image.cam_from_world.translation != other.translation) return false;
  }
  for (const auto& [id, point] : a.points) {
    if (!b.points.contains(id) || point.xyz != b.points.at(id).xyz) return false;
  }
  return true;
}

TEST(Refine, RecoversFromNoiseAndPlanesHelp) {
  const SyntheticMap map = MakeDeskMap();
  Output plain;
  Output fixed;
  Output joint;
  refine::Run(WithMode(PlaneMode::kOff), MakeInput(map), plain);
  refine::Run(WithMode(PlaneMode::kFixed), MakeInput(map), fixed);
  const Report report = refine::Run(WithMode(PlaneMode::kJoint), MakeInput(map), joint);
  const double before = AlignedCenterError(map.estimate, map.truth);
  const double without_planes = AlignedCenterError(plain.model, map.truth);
  EXPECT_LT(without_planes, 0.5 * before);
  EXPECT_LT(AlignedCenterError(fixed.model, map.truth), without_planes);
  EXPECT_LT(AlignedCenterError(joint.model, map.truth), without_planes);
  ASSERT_EQ(report.arms.size(), 3u);
  EXPECT_LT(report.arms[2].plane_rms_sigma, 0.5 * report.arms[1].plane_rms_sigma);
  EXPECT_LT(report.arms[2].reprojection_rms_px, 1.1 * report.arms[1].reprojection_rms_px);
  EXPECT_GT(report.planes.size(), 3u);
}

TEST(Refine, TheGaugeIsHeld) {
  const SyntheticMap map = MakeDeskMap();
  for (const PlaneMode mode : {PlaneMode::kOff, PlaneMode::kFixed, PlaneMode::kJoint}) {
    Output output;
    const Report report = refine::Run(WithMode(mode), MakeInput(map), output);
    EXPECT_LT(std::abs(report.gauge_scale_change), 1e-9);
    const Rigid3& before = map.estimate.images.begin()->second.cam_from_world;
    const Rigid3& after = output.model.images.begin()->second.cam_from_world;
    EXPECT_EQ((before.translation - after.translation).norm(), 0.0);
    EXPECT_LT(RotationAngle(before.rotation, after.rotation), 1e-12);
  }
}

class RefineScaleTest : public ::testing::TestWithParam<double> {};

TEST_P(RefineScaleTest, ScalingTheMapChangesNothingButTheScale) {
  const SyntheticMap map = MakeDeskMap();
  const double scale = GetParam();
  Input scaled = MakeInput(map);
  const Similarity3 scaling{scale, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero()};
  TransformReconstruction(scaling, scaled.model);
  for (auto& [id, plane] : scaled.semantics.planes) {
    plane.plane_in_world = TransformPlane(scaling, plane.plane_in_world);
    plane.centroid_in_world *= scale;
  }
  Output reference;
  Output output;
  const Report reference_report =
      refine::Run(WithMode(PlaneMode::kJoint), MakeInput(map), reference);
  const Report report = refine::Run(WithMode(PlaneMode::kJoint), scaled, output);
  EXPECT_EQ(report.membership.members, reference_report.membership.members);
  const auto a = Centers(reference.model, map.truth);
  const auto b = Centers(output.model, map.truth);
  const double depth = MedianDepth(reference.model);
  for (size_t i = 0; i < a.size(); ++i) EXPECT_LT((a[i] - b[i] / scale).norm(), 1e-5 * depth);
}

INSTANTIATE_TEST_SUITE_P(Scales, RefineScaleTest, ::testing::Values(0.01, 100.0));

TEST(Refine, OffAndWithoutPlanesAreTheSame) {
  const SyntheticMap map = MakeDeskMap();
  Input without_planes = MakeInput(map);
  without_planes.semantics = {};
  Output off;
  Output empty;
  const Report off_report = refine::Run(WithMode(PlaneMode::kOff), MakeInput(map), off);
  const Report empty_report = refine::Run(WithMode(PlaneMode::kJoint), without_planes, empty);
  EXPECT_TRUE(SameBytes(off.model, empty.model));
  EXPECT_TRUE(off_report.note.empty());
  EXPECT_NE(empty_report.note.find("no planes given"), std::string::npos);
}

TEST(Refine, TheSameInputGivesTheSameBytes) {
  const SyntheticMap map = MakeDeskMap();
  Output first;
  Output second;
  refine::Run(Options(), MakeInput(map), first);
  refine::Run(Options(), MakeInput(map), second);
  EXPECT_TRUE(SameBytes(first.model, second.model));
}

TEST(Refine, TheKeypointsSigmaIsMeasuredWhereItIsNotGiven) {
  for (const char* noise : {"pixel_sigma=0.3", "pixel_sigma=1.4"}) {
    const SyntheticMap map = MakeDeskMap({noise, "outlier_fraction=0.05"});
    Output output;
    const Report report = refine::Run(WithMode(PlaneMode::kOff), MakeInput(map), output);
    const double sigma = std::stod(std::string(noise).substr(12));
    EXPECT_NEAR(report.keypoint_sigma_px, sigma, 0.25 * sigma);
    Options options = WithMode(PlaneMode::kOff);
    options.keypoint_sigma_px = 2.0;
    EXPECT_EQ(refine::Run(options, MakeInput(map), output).keypoint_sigma_px, 2.0);
  }
}

/// Every keypoint of the map with this sigma.
KeypointSigmas AllSigmas(const Reconstruction& model, float sigma) {
  KeypointSigmas sigmas;
  for (const auto& [id, image] : model.images) sigmas[id].assign(image.points2D.size(), sigma);
  return sigmas;
}

TEST(Refine, KeypointsCountByTheirSigmas) {
  const SyntheticMap map = MakeDeskMap({"pixel_sigma=0.3"});
  Input input = MakeInput(map);
  KeypointSigmas sigmas = AllSigmas(map.estimate, 0.3F);
  Rng rng(5);
  for (auto& [id, image] : input.model.images) {
    for (size_t k = 0; k < image.points2D.size(); k += 2) {  // Every other one is poor.
      image.points2D[k].xy += 2.0 * Eigen::Vector2d(rng.Gaussian(), rng.Gaussian());
      sigmas[id][k] = 2.0F;
    }
  }
  for (const PlaneMode mode : {PlaneMode::kOff, PlaneMode::kJoint}) {
    Output alike;
    Output weighed;
    EXPECT_FALSE(refine::Run(WithMode(mode), input, alike).keypoints_differ);
    Input with_sigmas = input;
    with_sigmas.keypoint_sigmas = sigmas;
    EXPECT_TRUE(refine::Run(WithMode(mode), with_sigmas, weighed).keypoints_differ);
    EXPECT_LT(AlignedCenterError(weighed.model, map.truth),
              0.7 * AlignedCenterError(alike.model, map.truth));
  }
}

TEST(Refine, EqualSigmasOfAnySizeChangeNothing) {
  const SyntheticMap map = MakeDeskMap();
  Output without;
  refine::Run(Options(), MakeInput(map), without);
  for (const float sigma : {0.2F, 7.0F}) {
    Input input = MakeInput(map);
    input.keypoint_sigmas = AllSigmas(map.estimate, sigma);
    Output output;
    refine::Run(Options(), input, output);
    EXPECT_TRUE(SameBytes(without.model, output.model));
  }
}

TEST(Refine, WrongLabelsDoNoHarm) {
  const SyntheticMap map = MakeDeskMap({"wrong_label_fraction=0.3"});
  Output plain;
  Output planar;
  refine::Run(WithMode(PlaneMode::kOff), MakeInput(map), plain);
  refine::Run(Options(), MakeInput(map), planar);
  EXPECT_LE(AlignedCenterError(planar.model, map.truth),
            1.05 * AlignedCenterError(plain.model, map.truth));
}

TEST(Refine, OutlierObservationsAreDropped) {
  const SyntheticMap map = MakeDeskMap({"outlier_fraction=0.03"});
  Output output;
  const Report report = refine::Run(Options(), MakeInput(map), output);
  const double total = static_cast<double>(report.observations.total);
  EXPECT_GT(static_cast<double>(report.observations.outliers), 0.025 * total);
  EXPECT_LT(static_cast<double>(report.observations.outliers), 0.04 * total);
  EXPECT_EQ(output.model.NumObservations(), report.observations.used);
  CheckReconstruction(output.model, "output");
  CheckSemanticMap(output.semantics, output.model, "output");
}

TEST(Refine, FramesFollowTheKeyframes) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  double time = 10.0;
  for (const auto& [id, image] : input.model.images) {
    input.image_times_s.push_back(time);
    input.frames.push_back({time, image.cam_from_world.Inverse()});
    time += 0.5;
  }
  Output output;
  refine::Run(Options(), input, output);
  ASSERT_EQ(output.frames.size(), input.frames.size());
  ASSERT_EQ(output.keyframes.size(), input.frames.size());
  for (size_t i = 0; i < output.frames.size(); ++i) {
    EXPECT_LT((output.frames[i].world_from_camera.translation -
               output.keyframes[i].world_from_camera.translation)
                  .norm(),
              1e-9);
  }
}

/// Every second image is taken from the model and given as a frame with what it sees.
TEST(Refine, FramesAreRefinedAgainstTheRefinedMap) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  input.semantics = {};
  double time = 10.0;
  std::vector<Eigen::Vector3d> truth;
  for (const auto& [id, image] : map.estimate.images) {
    input.frames.push_back({time, image.cam_from_world.Inverse()});
    truth.push_back(map.truth.images.at(id).cam_from_world.CenterInB());
    if (id.value() % 2 == 0) {
      ObservedFrame frame{time, image.camera_id, {}};
      for (const Point2D& seen : image.points2D) {
        if (!seen.point_id.valid()) continue;
        frame.observations.push_back({seen.point_id, seen.xy.cast<float>(), 1.0F});
      }
      input.observations.push_back(frame);
      input.model.images.erase(id);
    } else {
      input.image_times_s.push_back(time);
    }
    time += 0.5;
  }
  for (auto& [id, point] : input.model.points) {
    std::erase_if(point.track,
                  [&](const TrackElement& e) { return !input.model.images.contains(e.image_id); });
  }
  const auto error = [&](const Trajectory& frames) {
    std::vector<Eigen::Vector3d> centers;
    for (const TimedPose& pose : frames) centers.push_back(pose.world_from_camera.translation);
    const auto truth_from_model = AlignPoints(truth, centers);
    double sum = 0.0;
    for (size_t i = 0; i < truth.size(); ++i) {
      sum += (truth[i] - *truth_from_model * centers[i]).squaredNorm();
    }
    return std::sqrt(sum);
  };
  Output refined;
  const Report report = refine::Run(Options(), input, refined);
  EXPECT_EQ(report.frames.num_frames, input.frames.size());
  EXPECT_EQ(report.frames.num_refined, input.observations.size());
  Options options;
  options.frames.enabled = false;
  Output carried;
  EXPECT_EQ(refine::Run(options, input, carried).frames.num_refined, 0u);
  EXPECT_LT(error(refined.frames), 0.7 * error(carried.frames));
  CheckFrameObservations(refined.observations, refined.model, refined.frames, "output");
}

// ---- camera height, bending ground, relations ----

/// A drive whose scale drifts slowly: each image sees only its neighbours' points.
SyntheticMap MakeDrive() {
  SyntheticMapOptions options;
  options.num_images = 40;
  options.num_points = 2000;
  options.max_track_window = 2;
  options.pixel_sigma = 1.5;
  options.drift_scale = 0.01;
  return MakeSyntheticMap("street", 1, options);
}

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

/// A drive that rises slowly above its road, seen too well for the road to bring it down.
SyntheticMap MakeClimb() {
  Scene scene = MakeScene("street", 1);
  constexpr int kKnots = 60;
  constexpr double kRiseM = 1.0;
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3d> targets;
  const double duration_s = scene.path.duration_s();
  for (int i = 0; i < kKnots; ++i) {
    const double part = i / (kKnots - 1.0);
    const Rigid3 pose = scene.path.WorldFromCamera(part * duration_s);
    positions.push_back(pose.translation + kRiseM * part * Eigen::Vector3d::UnitZ());
    targets.push_back(positions.back() + pose.rotation * Eigen::Vector3d::UnitZ());
  }
  scene.path = CameraPath(positions, targets, duration_s, {}, 1);
  SyntheticMapOptions options;
  options.num_images = 40;
  options.num_points = 4000;
  options.pixel_sigma = 0.2;
  return MakeSyntheticMap(scene, 1, options);
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

TEST(RefineBending, LongSurfacesOfBendingClassesAreCut) {
  const SyntheticMap map = MakeDrive();
  Options options;
  options.camera_height.mode = CameraHeightMode::kOff;
  Output cut;
  const Report report = refine::Run(options, MakeInput(map), cut);
  options.bending.classes.clear();
  Output whole;
  const Report whole_report = refine::Run(options, MakeInput(map), whole);
  EXPECT_EQ(whole_report.planes.size(), map.semantics.planes.size());
  EXPECT_GT(report.planes.size(), whole_report.planes.size());
}

TEST(RefineRelations, ParallelAndOrthogonalPlanesComeNearerToIt) {
  const SyntheticMap map = MakeDeskMap();
  Options options;
  Output with;
  const Report report = refine::Run(options, MakeInput(map), with);
  size_t enforced = 0;
  for (const PlanePairReport& pair : report.pairs) {
    if (!pair.enforced) continue;
    ++enforced;
    EXPECT_LT(pair.deviation_deg.back(), std::max(1.0, pair.deviation_deg.front()));
  }
  EXPECT_GT(enforced, 0u);
  options.relations.enabled = false;
  Output without;
  for (const PlanePairReport& pair : refine::Run(options, MakeInput(map), without).pairs) {
    EXPECT_FALSE(pair.enforced);
  }
}

/// The two largest parallel planes of the map whose distance is not small.
std::pair<PlaneId, PlaneId> ParallelPair(const SyntheticMap& map) {
  std::pair<PlaneId, PlaneId> best;
  size_t most = 0;
  for (const auto& [a, surface_a] : map.semantics.planes) {
    for (const auto& [b, surface_b] : map.semantics.planes) {
      const Plane& plane_a = map.true_planes.at(a);
      const Plane& plane_b = map.true_planes.at(b);
      if (b <= a || PlaneAngle(plane_a, plane_b) > 1e-6) continue;
      if (std::abs(StepBetween(plane_a, plane_b, Eigen::Vector3d::Zero())) < 0.1) continue;
      const size_t points = std::min(surface_a.inliers.size(), surface_b.inliers.size());
      if (points <= most) continue;
      most = points;
      best = {a, b};
    }
  }
  return best;
}

TEST(RefineRelations, PlanesKeepTheDistanceThatIsKnown) {
  const SyntheticMap map = MakeDeskMap();
  const auto [a, b] = ParallelPair(map);
  ASSERT_TRUE(a.valid());
  const double truth =
      std::abs(StepBetween(map.true_planes.at(a), map.true_planes.at(b), Eigen::Vector3d::Zero()));
  for (const double factor : {1.0, 1.02}) {  // What is said is done, true or not.
    Input input = MakeInput(map);
    input.constraints.plane_distances = {{a, b, factor * truth, 1e-5 * truth}};
    Output output;
    const Report report = refine::Run(Options(), input, output);
    ASSERT_EQ(report.distances.size(), 1u);
    EXPECT_EQ(report.distances[0].known, factor * truth);
    ASSERT_EQ(report.distances[0].measured.size(), report.arms.size());
    const Plane& plane_a = output.semantics.planes.at(a).plane_in_world;
    const Plane& plane_b = output.semantics.planes.at(b).plane_in_world;
    EXPECT_NEAR(report.distances[0].measured.back(), factor * truth, 0.01 * truth);
    EXPECT_LT(PlaneAngle(plane_a, plane_b), 0.01);
  }
}

TEST(RefineRelations, DistancesOfPlanesThatCannotHaveOneAreRefused) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  Output output;
  input.constraints.plane_distances = {{PlaneId(0), PlaneId(987), 1.0, 0.01}};
  EXPECT_THROW(refine::Run(Options(), input, output), InputError);
  for (const auto& [a, plane_a] : map.true_planes) {
    for (const auto& [b, plane_b] : map.true_planes) {
      if (PlaneAngle(plane_a, plane_b) < 1.0) continue;
      input.constraints.plane_distances = {{a, b, 1.0, 0.01}};
      EXPECT_THROW(refine::Run(Options(), input, output), InputError);
      return;
    }
  }
  FAIL() << "no planes at an angle";
}

// ---- degenerate input: a clear error or a sound result ----

TEST(RefineBadInput, NoImagesOrNoPointsOrOneImage) {
  const SyntheticMap map = MakeDeskMap();
  Output output;
  EXPECT_THROW(refine::Run(Options(), Input(), output), InputError);
  Input no_points = MakeInput(map);
  no_points.semantics = {};
  no_points.model.points.clear();
  for (auto& [id, image] : no_points.model.images) image.points2D.clear();
  EXPECT_THROW(refine::Run(Options(), no_points, output), InputError);
}

/// Keeps the first `count` images and what they see.
Reconstruction FirstImages(const Reconstruction& model, size_t count) {
  Reconstruction part = model;
  while (part.images.size() > count) part.images.erase(std::prev(part.images.end()));
  for (auto& [id, point] : part.points) {
    std::erase_if(point.track, [&](const TrackElement& element) {
      return !part.images.contains(element.image_id);
    });
  }
  return part;
}

TEST(RefineBadInput, OneImageIsRefusedAndTwoAreEnough) {
  const SyntheticMap map = MakeDeskMap();
  Output output;
  Input one;
  one.model = FirstImages(map.estimate, 1);
  EXPECT_THROW(refine::Run(Options(), one, output), InputError);
  Input two;
  two.model = FirstImages(map.estimate, 2);
  two.semantics = map.semantics;
  const Report report = refine::Run(Options(), two, output);
  EXPECT_EQ(report.num_images_in_use, 2u);
  EXPECT_LT(report.arms.back().reprojection_rms_px, 1.5);
}

TEST(RefineBadInput, PointsBehindCamerasAreLeftOut) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  const Image& image = input.model.images.begin()->second;
  const Eigen::Vector3d behind = image.cam_from_world.Inverse() * Eigen::Vector3d(0.0, 0.0, -5.0);
  size_t observations = 0;
  for (auto& [id, point] : input.model.points) {
    if (observations > 100) break;
    point.xyz = behind;
    observations += point.track.size();
  }
  Options options;
  options.retriangulation.enabled = false;
  Output output;
  const Report report = refine::Run(options, input, output);
  EXPECT_GT(report.observations.behind + report.observations.outliers + report.observations.too_few,
            90u);
  EXPECT_LT(AlignedCenterError(output.model, map.truth),
            AlignedCenterError(map.estimate, map.truth));
  // Their observations tell where they are.
  Output again;
  const Report mended = refine::Run(Options(), input, again);
  EXPECT_GT(mended.num_retriangulated, 10u);
  EXPECT_GT(mended.observations.used, report.observations.used + 80);
  EXPECT_LT(AlignedCenterError(again.model, map.truth),
            AlignedCenterError(map.estimate, map.truth));
}

TEST(RefineBadInput, RepeatedObservationsUnusedCamerasAndBlindImages) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  input.model.cameras[CameraId(77)] = input.model.cameras.begin()->second;
  Image blind = input.model.images.rbegin()->second;
  blind.id = ImageId(900);
  blind.points2D = {{{100.0, 100.0}, kInvalidPointId}};
  input.model.images[blind.id] = blind;
  // One point twice in one image.
  auto& [point_id, point] = *input.model.points.begin();
  Image& image = input.model.images.at(point.track.front().image_id);
  Point2D again = image.points2D[point.track.front().point2D_index];
  again.xy.x() += 0.5;
  point.track.push_back({image.id, static_cast<uint32_t>(image.points2D.size())});
  image.points2D.push_back(again);
  ScenePoint unseen;
  unseen.xyz = point.xyz;
  input.model.points[PointId(999999)] = unseen;

  Output output;
  const Report report = refine::Run(Options(), input, output);
  EXPECT_EQ(report.num_images, report.num_images_in_use + 1);
  EXPECT_LT(AlignedCenterError(output.model, map.truth),
            0.5 * AlignedCenterError(map.estimate, map.truth));
  // The blind image went along with the one it stood on.
  const Eigen::Vector3d carried = output.model.images.at(blind.id).cam_from_world.CenterInB();
  const Eigen::Vector3d neighbour =
      std::prev(std::prev(output.model.images.end()))->second.cam_from_world.CenterInB();
  EXPECT_LT((carried - neighbour).norm(), 1e-9);
  EXPECT_FALSE(output.model.points.contains(PointId(999999)));
  CheckReconstruction(output.model, "output");
}

TEST(RefineBadInput, ARefusedSolveThrowsAndGivesNothing) {
  const SyntheticMap map = MakeDeskMap();
  Options options;
  options.solver.max_iterations = -1;
  Output output;
  EXPECT_THROW(refine::Run(options, MakeInput(map), output), std::runtime_error);
  EXPECT_TRUE(output.model.images.empty());
}

}  // namespace
}  // namespace s3lam::refine
