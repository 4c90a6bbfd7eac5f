#include "s3lam/refine/pipeline.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>

#include "refine/refine_fixture.h"
#include "s3lam/base/rng.h"
#include "s3lam/geometry/alignment.h"

namespace s3lam::refine {
namespace {

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

/// From the first camera [map units].
double DistanceOf(ImageId id, const Reconstruction& model) {
  return (model.images.at(id).cam_from_world.CenterInB() -
          model.images.begin()->second.cam_from_world.CenterInB())
      .norm();
}

/// The image whose camera is farthest from the first one's.
ImageId FarthestImage(const Reconstruction& model) {
  const auto farthest =
      std::max_element(model.images.begin(), model.images.end(), [&](const auto& a, const auto& b) {
        return DistanceOf(a.first, model) < DistanceOf(b.first, model);
      });
  return farthest->first;
}

/// Takes the observations of an image away, all but those of its first keypoints.
void ForgetWhatWasSeen(ImageId id, size_t num_kept, Reconstruction& model) {
  std::vector<Point2D>& keypoints = model.images.at(id).points2D;
  for (size_t i = num_kept; i < keypoints.size(); ++i) keypoints[i].point_id = kInvalidPointId;
  for (auto& [point_id, point] : model.points) {
    std::erase_if(point.track, [&](const TrackElement& element) {
      return element.image_id == id && element.point2D_index >= num_kept;
    });
  }
}

TEST(Refine, WhereAnotherCameraHoldsTheScaleItsOwnDistanceIsTold) {
  Input input = MakeInput(MakeDeskMap());
  const ImageId lost = FarthestImage(input.model);
  constexpr size_t kKept = 8;  // Half of which do not fit: too few are left.
  ForgetWhatWasSeen(lost, kKept, input.model);
  for (size_t i = 0; i < kKept; i += 2) {
    input.model.images.at(lost).points2D[i].xy.x() += i % 4 == 0 ? 80.0 : -80.0;
  }
  Output output;
  const Report report = refine::Run(WithMode(PlaneMode::kOff), input, output);
  ASSERT_EQ(report.num_images_in_use, 15U);
  Reconstruction others = input.model;
  others.images.erase(lost);
  const ImageId next = FarthestImage(others);
  EXPECT_NEAR(report.gauge_scale_change,
              DistanceOf(next, output.model) / DistanceOf(next, input.model) - 1.0, 1e-9);
}

/// The least number of points that a plane has in all rounds but one that has fewer; empty if there
/// is none.
std::optional<int> MembersBeforeALoss(const Report& report) {
  std::optional<size_t> least;
  for (const OuterIteration& it : report.iterations) {
    if (!it.with_planes) continue;
    if (least && it.membership.members < *least) return static_cast<int>(*least);
    least = std::min(least.value_or(it.membership.members), it.membership.members);
  }
  return std::nullopt;
}

/// Of a map with one plane, which loses points from one round to the next: with planes of so many
/// points alone it loses the plane.
struct ShrinkingPlane {
  Input input;
  Options options;
};

std::optional<ShrinkingPlane> FindShrinkingPlane(const SyntheticMap& map) {
  for (const auto& plane : map.semantics.planes) {
    for (const double max_sigma : {1.96, 1.0, 0.5}) {
      ShrinkingPlane shrinking{MakeInput(map), Options()};
      shrinking.input.semantics.planes = {plane};
      MembershipOptions& membership = shrinking.options.planes.membership;
      membership.max_sigma = max_sigma;
      Output output;
      const auto members =
          MembersBeforeALoss(refine::Run(shrinking.options, shrinking.input, output));
      if (!members) continue;
      membership.min_points = *members;
      return shrinking;
    }
  }
  return std::nullopt;
}

TEST(Refine, PlanesThatLoseTheirPointsOnTheWayLeaveNothingBehind) {
  const auto shrinking = FindShrinkingPlane(MakeDeskMap());
  ASSERT_TRUE(shrinking.has_value());
  Output lost;
  const Report report = refine::Run(shrinking->options, shrinking->input, lost);
  EXPECT_EQ(report.arms.back().name, "plain");
  EXPECT_EQ(report.membership.members, 0U);
  EXPECT_NE(report.note.find("plain bundle adjustment"), std::string::npos);
  EXPECT_TRUE(lost.semantics.planes.empty());
  Output off;
  refine::Run(WithMode(PlaneMode::kOff), shrinking->input, off);
  EXPECT_TRUE(SameBytes(lost.model, off.model));
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

/// Every second image is of a camera of four times the resolution, and its keypoints are so much
/// less precise in pixels.
Input WithTwoResolutions(const SyntheticMap& map) {
  Input input = MakeInput(map);
  Camera large = input.model.cameras.begin()->second;
  large.id = CameraId(50);
  large.width *= 4;
  large.height *= 4;
  for (size_t i = 0; i < 4; ++i) large.params[i] *= 4.0;  // Focal lengths and principal point.
  input.model.cameras[large.id] = large;
  for (auto& [id, image] : input.model.images) {
    if (id.value() % 2 != 0) continue;
    image.camera_id = large.id;
    for (Point2D& point : image.points2D) point.xy *= 4.0;
  }
  return input;
}

/// The part of a camera's observations that the output does not have.
double LostShare(const Reconstruction& before, const Reconstruction& after, CameraId camera) {
  const auto count = [camera](const Reconstruction& model) {
    double sum = 0.0;
    for (const auto& [id, image] : model.images) {
      if (image.camera_id != camera) continue;
      for (const Point2D& point : image.points2D) sum += point.point_id.valid() ? 1.0 : 0.0;
    }
    return sum;
  };
  return 1.0 - count(after) / count(before);
}

TEST(Refine, KeypointsOfCamerasCountByTheirResolution) {
  // Cameras that saw much count by their errors, others by their images' size.
  for (const char* points : {"num_points=700", "num_points=130"}) {
    double error = 0.0;
    double error_if_alike = 0.0;
    for (const char* images :
         {"num_images=14", "num_images=16", "num_images=20", "num_images=24", "num_images=30"}) {
      const SyntheticMap map = MakeDeskMap({"outlier_fraction=0.03", points, images});
      const Input input = WithTwoResolutions(map);
      Output output;
      refine::Run(WithMode(PlaneMode::kOff), input, output);
      Input all_alike = input;
      all_alike.keypoint_sigmas = AllSigmas(input.model, 1.0F);
      Output alike;
      refine::Run(WithMode(PlaneMode::kOff), all_alike, alike);
      const double small = LostShare(input.model, output.model, input.model.cameras.begin()->first);
      const double large = LostShare(input.model, output.model, CameraId(50));
      EXPECT_NEAR(small, large, 0.03);
      error += AlignedCenterError(output.model, map.truth);
      error_if_alike += AlignedCenterError(alike.model, map.truth);
    }
    EXPECT_LT(error, 0.9 * error_if_alike);
  }
}

TEST(Refine, KeypointsOfCamerasCountByWhatTheSolveLeaves) {
  const SyntheticMap map = MakeDeskMap({"outlier_fraction=0.03"});
  Input input = MakeInput(map);
  const CameraId first = input.model.cameras.begin()->first;
  Camera second = input.model.cameras.begin()->second;
  second.id = CameraId(50);
  input.model.cameras[second.id] = second;
  Rng rng(5);
  for (auto& [id, image] : input.model.images) {
    if (id.value() % 2 != 0) continue;
    image.camera_id = second.id;  // Whose images are poorly placed before.
    image.cam_from_world.translation +=
        0.1 * Eigen::Vector3d(rng.Gaussian(), rng.Gaussian(), rng.Gaussian());
  }
  for (const char* sigma : {"keypoint_sigma_px=0", "keypoint_sigma_px=0.7"}) {
    Output output;
    refine::Run(MakeOptions({"planes.mode=off", sigma}), input, output);
    EXPECT_NEAR(LostShare(input.model, output.model, first),
                LostShare(input.model, output.model, second.id), 0.01);
  }
}

/// The same model with other ids of its images, so that neighbours are no longer neighbours by id.
Reconstruction Shuffled(const Reconstruction& model) {
  const auto shuffled = [](ImageId id) { return ImageId(id.value() * 7 % 17); };
  Reconstruction result = model;
  result.images.clear();
  for (const auto& [id, image] : model.images) {
    Image& moved = result.images[shuffled(id)] = image;
    moved.id = shuffled(id);
  }
  for (auto& [id, point] : result.points) {
    for (TrackElement& element : point.track) element.image_id = shuffled(element.image_id);
  }
  return result;
}

/// Distance from where it should be, if all the others are aligned.
double ErrorOf(ImageId id, const Reconstruction& model, const Reconstruction& truth) {
  Reconstruction others = truth;
  others.images.erase(id);
  const auto truth_from_model = AlignPoints(Centers(truth, others), Centers(model, others));
  return (*truth_from_model * model.images.at(id).cam_from_world.CenterInB() -
          truth.images.at(id).cam_from_world.CenterInB())
      .norm();
}

TEST(Refine, AnImageThatSeesNothingGoesWithTheNearestOnes) {
  const SyntheticMap map = MakeDeskMap({"center_sigma=0.001", "drift_rotation_deg=0.5",
                                        "drift_translation=0.01", "drift_scale_trend=0.02"});
  const Reconstruction truth = Shuffled(map.truth);
  double before = 0.0;
  double after = 0.0;
  for (const auto& [id, image] : truth.images) {
    Input input;
    input.model = Shuffled(map.estimate);
    ForgetWhatWasSeen(id, 0, input.model);
    Output output;
    EXPECT_EQ(refine::Run(WithMode(PlaneMode::kOff), input, output).num_images_in_use, 15u);
    before += ErrorOf(id, input.model, truth);
    after += ErrorOf(id, output.model, truth);
  }
  EXPECT_LT(after, 0.7 * before);
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

}  // namespace
}  // namespace s3lam::refine
