#include "s3lam/refine/retriangulation.h"

#include <gtest/gtest.h>

#include "refine/refine_fixture.h"
#include "s3lam/base/rng.h"
#include "s3lam/base/statistics.h"

namespace s3lam::refine {
namespace {

BundleMap TrueMap() {
  const SyntheticMap map = MakeDeskMap({"max_track_window=0"});
  BundleMap bundle = BuildBundleMap(map.truth);
  SelectObservations({}, 1.0, false, bundle);
  return bundle;
}

TEST(Retriangulation, AMisplacedPointIsFoundAgain) {
  BundleMap map = TrueMap();
  const size_t used = map.problem.observations.size();
  const Eigen::Vector3d truth = map.problem.points[7];
  map.problem.points[7] += Eigen::Vector3d(0.5, -0.3, 0.4);
  const Eigen::Vector3d other = map.problem.points[8];
  SelectObservations({}, 1.0, false, map);
  EXPECT_LT(map.problem.observations.size(), used);
  EXPECT_EQ(RetriangulatePoints({}, {}, 1.0, map), 1u);
  EXPECT_LT((map.problem.points[7] - truth).norm(), 0.02);
  EXPECT_EQ(map.problem.points[8], other);
  SelectObservations({}, 1.0, false, map);
  EXPECT_EQ(map.problem.observations.size(), used);
}

TEST(Retriangulation, NothingMovesWhereEverythingFitsOrMayNotMove) {
  BundleMap map = TrueMap();
  EXPECT_EQ(RetriangulatePoints({}, {}, 1.0, map), 0u);
  map.problem.points[7] += Eigen::Vector3d(0.5, -0.3, 0.4);
  SelectObservations({}, 1.0, false, map);
  RetriangulationOptions off;
  off.enabled = false;
  EXPECT_EQ(RetriangulatePoints(off, {}, 1.0, map), 0u);
  map.problem.point_is_constant.assign(map.problem.points.size(), 0);
  map.problem.point_is_constant[7] = 1;
  EXPECT_EQ(RetriangulatePoints({}, {}, 1.0, map), 0u);
}

/// The observations of one point are given to two, by turns; the second is the last point.
struct SplitPoint {
  Reconstruction model;
  PointDescriptors descriptors;
  PointId first, second;
};

SplitPoint MakeSplitPoint() {
  SplitPoint split;
  split.model = MakeDeskMap({"max_track_window=0"}).truth;
  Rng rng(5);
  for (const auto& [id, point] : split.model.points) {
    for (uint8_t& byte : split.descriptors[id]) byte = static_cast<uint8_t>(rng.Below(256));
  }
  auto longest = split.model.points.begin();
  for (auto it = split.model.points.begin(); it != split.model.points.end(); ++it) {
    if (it->second.track.size() > longest->second.track.size()) longest = it;
  }
  split.first = longest->first;
  split.second = PointId(split.model.points.rbegin()->first.value() + 1);
  ScenePoint& second = split.model.points[split.second];
  ScenePoint& first = split.model.points.at(split.first);
  second.xyz = first.xyz;
  const std::vector<TrackElement> track = first.track;
  first.track.clear();
  for (size_t k = 0; k < track.size(); ++k) {
    const bool to_second = k % 3 == 1;
    (to_second ? second : first).track.push_back(track[k]);
    if (!to_second) continue;
    split.model.images.at(track[k].image_id).points2D[track[k].point2D_index].point_id =
        split.second;
  }
  split.descriptors[split.second] = split.descriptors.at(split.first);
  split.descriptors[split.second][0] ^= 0x15;
  return split;
}

TEST(MergePoints, APointInTwoPartsBecomesOne) {
  const SplitPoint split = MakeSplitPoint();
  CheckReconstruction(split.model, "split");
  BundleMap map = BuildBundleMap(split.model);
  SelectObservations({}, 1.0, false, map);
  EXPECT_EQ(MergePoints({}, 1.0, map), 0u);  // Nothing is known of their looks.
  AddLooks(split.descriptors, {}, map);
  EXPECT_EQ(MergePoints({}, 1.0, map), 1u);
  SelectObservations({}, 1.0, false, map);
  const Reconstruction merged = ToReconstruction(map, split.model);
  CheckReconstruction(merged, "merged");
  EXPECT_FALSE(merged.points.contains(split.second));
  EXPECT_EQ(map.merged_into.at(split.second), split.first);
  EXPECT_EQ(merged.points.at(split.first).track.size(),
            split.model.points.at(split.first).track.size() +
                split.model.points.at(split.second).track.size());
  EXPECT_EQ(MergePoints({}, 1.0, map), 0u);
}

/// Adds points that two images see very far away, more than there are near ones.
void AddFarPoints(SplitPoint& split) {
  constexpr double kFar = 300.0;  // m
  Rng rng(6);
  for (uint64_t n = 0; n < 1200; ++n) {
    auto first = std::next(split.model.images.begin(), static_cast<int>(n % 15));
    const Rigid3 world_from_camera = first->second.cam_from_world.Inverse();
    const PointId id(10'000 + n);
    ScenePoint point;
    point.xyz = world_from_camera *
                Eigen::Vector3d(rng.Uniform(-0.2, 0.2) * kFar, rng.Uniform(-0.2, 0.2) * kFar, kFar);
    for (const auto& it : {first, std::next(first)}) {
      Image& image = it->second;
      const auto xy = split.model.CameraOf(image).ImageFromCamera(image.cam_from_world * point.xyz);
      if (!xy) continue;
      point.track.push_back({image.id, static_cast<uint32_t>(image.points2D.size())});
      image.points2D.push_back({*xy, id});
    }
    split.model.points[id] = point;
    for (uint8_t& byte : split.descriptors[id]) byte = static_cast<uint8_t>(rng.Below(256));
  }
}

TEST(MergePoints, NearPointsAreFoundAmongMoreFarOnes) {
  SplitPoint split = MakeSplitPoint();
  AddFarPoints(split);
  BundleMap map = BuildBundleMap(split.model);
  SelectObservations({}, 1.0, false, map);
  AddLooks(split.descriptors, {}, map);
  ASSERT_GT(Median(PixelSizes(map.problem)), 0.1);
  EXPECT_EQ(MergePoints({}, 1.0, map), 1u);
  EXPECT_EQ(map.merged_into.at(split.second), split.first);
}

TEST(MergePoints, WhatLooksDifferentOrIsOfAnotherObjectStaysApart) {
  const SplitPoint split = MakeSplitPoint();
  BundleMap map = BuildBundleMap(split.model);
  SelectObservations({}, 1.0, false, map);
  PointDescriptors different = split.descriptors;
  for (uint8_t& byte : different[split.second]) byte = static_cast<uint8_t>(~byte);
  AddLooks(different, {}, map);
  EXPECT_EQ(MergePoints({}, 1.0, map), 0u);
  AddLooks(split.descriptors, {}, map);
  map.looks[map.IndexOfPoint(split.second)].group = 5;
  EXPECT_EQ(MergePoints({}, 1.0, map), 0u);
}

TEST(RefineRetriangulation, MisplacedPointsComeBack) {
  const SyntheticMap map = MakeDeskMap();
  Input input = MakeInput(map);
  size_t count = 0;
  for (auto& [id, point] : input.model.points) {
    if (++count % 10 == 0) point.xyz += Eigen::Vector3d(0.4, 0.3, -0.2);
  }
  Output with;
  Output without;
  const Report report = refine::Run(MakeOptions({}), input, with);
  const Report off = refine::Run(MakeOptions({"retriangulation.enabled=false"}), input, without);
  EXPECT_GE(report.observations.used, off.observations.used);
  EXPECT_GT(static_cast<double>(report.observations.used),
            0.99 * static_cast<double>(report.observations.total));
  CheckReconstruction(with.model, "output");
}

}  // namespace
}  // namespace s3lam::refine
