#include "s3lam/refine/pipeline.h"

#include <gtest/gtest.h>

#include "refine/refine_fixture.h"
#include "s3lam/base/error.h"

namespace s3lam::refine {
namespace {

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
