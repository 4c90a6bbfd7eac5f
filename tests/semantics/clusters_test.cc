#include "s3lam/semantics/clusters.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "semantics/semantics_fixture.h"

namespace s3lam {
namespace {

using testing::ObservationBuilder;

ClassDistributions OneHot(const std::vector<int>& classes) {
  ClassDistributions d = ClassDistributions::Zero(static_cast<Eigen::Index>(classes.size()), 3);
  for (size_t i = 0; i < classes.size(); ++i) d(static_cast<Eigen::Index>(i), classes[i]) = 1.0F;
  return d;
}

/// Class 0 is stuff, the others are things.
ClassTable Table() {
  ClassTable table{"test", {}};
  for (int id = 0; id < 3; ++id) {
    table.classes.push_back({id, "c", id > 0, false, false, 50, {}, {}});
  }
  return table;
}

TEST(ClusterByClassAndInstance, VotesWithinThePointsClass) {
  ObservationBuilder builder;
  const int32_t a = builder.AddSegment(0, 1);
  const int32_t b = builder.AddSegment(1, 1);
  const int32_t other_class = builder.AddSegment(2, 2);
  builder.AddPoint({a, b, other_class});
  builder.AddPoint({b, other_class});
  const InstanceAssignment instances{{4, 4, 7}, 8};
  const auto clusters = ClusterByClassAndInstance(builder.result(), instances, OneHot({1, 2}));
  ASSERT_EQ(clusters.size(), 2U);
  EXPECT_EQ(clusters[0].class_index, 1);
  EXPECT_EQ(clusters[0].points, std::vector<PointId>{builder.result().points[0]});
  EXPECT_EQ(clusters[0].segments.size(), 2U);
  EXPECT_EQ(clusters[1].class_index, 2);
  EXPECT_EQ(clusters[1].points, std::vector<PointId>{builder.result().points[1]});
}

TEST(ClusterByInstance, TakesTheClassThePointsAgreeOn) {
  ObservationBuilder builder;
  const int32_t a = builder.AddSegment(0, 1);
  const int32_t b = builder.AddSegment(1, 2);
  for (int i = 0; i < 3; ++i) builder.AddPoint({a, b});
  const auto clusters =
      ClusterByInstance(builder.result(), {{0, 0}, 1}, OneHot({1, 2, 1}), Table());
  ASSERT_EQ(clusters.size(), 1U);
  EXPECT_EQ(clusters[0].class_index, 1);
  EXPECT_EQ(clusters[0].points.size(), 3U);
  EXPECT_EQ(clusters[0].segments.size(), 2U);
}

TEST(ClusterByInstance, JoinsStuffButNotThings) {
  ObservationBuilder builder;
  std::vector<int32_t> segments;
  for (uint32_t f = 0; f < 4; ++f) segments.push_back(builder.AddSegment(f, f < 2 ? 0 : 1));
  for (const int32_t s : segments) builder.AddPoint({s});
  const auto clusters =
      ClusterByInstance(builder.result(), {{0, 1, 2, 3}, 4}, OneHot({0, 0, 1, 1}), Table());
  ASSERT_EQ(clusters.size(), 3U);
  EXPECT_EQ(clusters[0].points.size(), 2U);
  EXPECT_EQ(clusters[0].segments.size(), 2U);
  EXPECT_EQ(clusters[1].points.size(), 1U);
}

TEST(ClusterByInstance, BordersVoteOnlyAlone) {
  ObservationBuilder builder;
  const int32_t a = builder.AddSegment(0, 1);
  const int32_t b = builder.AddSegment(1, 1);
  const int32_t c = builder.AddSegment(2, 1);
  builder.AddPoint({a, b, c});
  builder.result().observations[0].near_border = true;
  builder.result().observations[1].near_border = true;
  const auto clusters = ClusterByInstance(builder.result(), {{0, 0, 1}, 2}, OneHot({1}), Table());
  ASSERT_EQ(clusters.size(), 1U);
  EXPECT_EQ(clusters[0].segments.front(), builder.result().segments[2].ref);
}

/// Two clusters of ten points each, `apart` from each other along x; descriptors of the second
/// equal those of the first for `shared` points.
struct TwoClusters {
  Reconstruction reconstruction;
  PointDescriptors descriptors;
  std::vector<Cluster> clusters;

  TwoClusters(double apart, size_t shared) {
    clusters.resize(2);
    for (size_t k = 0; k < 2; ++k) {
      for (size_t i = 0; i < 10; ++i) {
        const PointId id(100 * k + i);
        reconstruction.points[id].xyz = {apart * static_cast<double>(k),
                                         0.01 * static_cast<double>(i), 0};
        std::array<uint8_t, 32>& d = descriptors[id];
        d.fill(static_cast<uint8_t>(17 * i + 3));
        for (size_t byte = 0; byte < 32 && k == 1 && i >= shared; ++byte) d[byte] ^= 0x55;
        clusters[k].points.push_back(id);
      }
    }
  }

  int Merge() {
    return MergeClusters(reconstruction, descriptors, 1.0, ClusterOptions{}, clusters);
  }
};

TEST(MergeClusters, JoinsWhatLooksAlikeInOnePlace) {
  TwoClusters scene(0.05, 9);
  EXPECT_EQ(scene.Merge(), 1);
  ASSERT_EQ(scene.clusters.size(), 1U);
  EXPECT_EQ(scene.clusters[0].points.size(), 20U);
  EXPECT_TRUE(std::is_sorted(scene.clusters[0].points.begin(), scene.clusters[0].points.end()));
}

TEST(MergeClusters, KeepsWhatDiffersOrLiesApart) {
  EXPECT_EQ(TwoClusters(0.05, 8).Merge(), 0);  // 80 % is not more than 80 %.
  EXPECT_EQ(TwoClusters(0.5, 10).Merge(), 0);
  TwoClusters other_class(0.05, 10);
  other_class.clusters[1].class_index = 1;
  EXPECT_EQ(other_class.Merge(), 0);
  TwoClusters no_descriptors(0.05, 10);
  no_descriptors.descriptors.clear();
  EXPECT_EQ(no_descriptors.Merge(), 0);
}

/// An object seen in frame 0, and in frame 1 as one of two segments of its class. `inside` of its
/// ten points of frame 0 fall into the right one there, the others into the other.
std::vector<Cluster> SeenTwice(int inside, ObservationBuilder& builder) {
  const std::array<int32_t, 3> segments = {builder.AddSegment(0, 1), builder.AddSegment(1, 1),
                                           builder.AddSegment(1, 1)};
  std::vector<Cluster> clusters(3);
  for (size_t k = 0; k < 3; ++k) {
    clusters[k].class_index = 1;
    clusters[k].segments = {builder.result().segments[static_cast<size_t>(segments[k])].ref};
    for (int i = 0; i < 10; ++i) {
      std::vector<int32_t> seen_in = {segments[k]};
      if (k == 0) seen_in.push_back(segments[i < inside ? 1 : 2]);
      const uint32_t row = builder.AddPoint(seen_in);
      if (k == 0) builder.result().observations.back().predicted = true;
      clusters[k].points.push_back(builder.result().points[row]);
    }
  }
  return clusters;
}

TEST(MergeByReprojection, JoinsWhatFallsIntoTheSegmentsOfAnother) {
  ObservationBuilder builder;
  std::vector<Cluster> clusters = SeenTwice(9, builder);
  EXPECT_EQ(MergeByReprojection(builder.result(), ClusterOptions{}, clusters), 1);
  ASSERT_EQ(clusters.size(), 2U);
  EXPECT_EQ(clusters[0].points.size(), 20U);
  EXPECT_EQ(clusters[0].segments.size(), 2U);
  EXPECT_EQ(clusters[1].points.size(), 10U);
}

TEST(MergeByReprojection, KeepsWhatFallsElsewhere) {
  ObservationBuilder spread;
  std::vector<Cluster> clusters = SeenTwice(8, spread);  // 80 % is not more than 80 %.
  EXPECT_EQ(MergeByReprojection(spread.result(), ClusterOptions{}, clusters), 0);
  ObservationBuilder other_class;
  clusters = SeenTwice(10, other_class);
  clusters[0].class_index = 0;
  EXPECT_EQ(MergeByReprojection(other_class.result(), ClusterOptions{}, clusters), 0);
}

TEST(AddClusters, DropsSmallOnesAndNumbersTheRest) {
  TwoClusters scene(2.0, 0);
  scene.clusters[0].points.resize(3);
  SemanticMap map;
  for (const auto& [id, point] : scene.reconstruction.points) map.points.push_back(id);
  AddClusters(scene.reconstruction, scene.clusters, ClusterOptions{}, map);
  ASSERT_EQ(map.clusters.size(), 1U);
  const Cluster& cluster = map.clusters.at(ClusterId(0));
  EXPECT_TRUE(cluster.centroid_in_world.isApprox(Eigen::Vector3d(2.0, 0.045, 0.0)));
  EXPECT_FALSE(map.cluster_of_point[0].valid());
  EXPECT_EQ(map.cluster_of_point[10], ClusterId(0));
}

/// The near and the far side of a cup, each more than half of it, seen in three images of its own.
struct CupFromTwoSides {
  Reconstruction reconstruction;
  std::vector<Cluster> clusters;

  explicit CupFromTwoSides(double apart = 0.0) {
    clusters.resize(2);
    for (size_t k = 0; k < 2; ++k) {
      clusters[k].class_index = 1;
      for (size_t i = 0; i < 60; ++i) {
        const double angle =
            std::numbers::pi * (static_cast<double>(k) + 1.3 * static_cast<double>(i % 10) / 9.0);
        const PointId id(100 * k + i);
        reconstruction.points[id].xyz = {0.04 * std::cos(angle) + apart * static_cast<double>(k),
                                         0.04 * std::sin(angle),
                                         0.02 * static_cast<double>(i / 10)};
        clusters[k].points.push_back(id);
      }
      for (uint32_t f = 0; f < 3; ++f) {
        clusters[k].segments.push_back({ImageId(static_cast<uint32_t>(10 * k) + f), 7});
      }
    }
  }

  int Merge(const ClusterOptions& options = {}) {
    return MergeSeenApart(reconstruction, Table(), options, clusters);
  }
};

TEST(MergeSeenApart, JoinsTheSidesOfOneThing) {
  CupFromTwoSides cup;
  EXPECT_EQ(cup.Merge(), 1);
  ASSERT_EQ(cup.clusters.size(), 1U);
  EXPECT_EQ(cup.clusters[0].points.size(), 120U);
  EXPECT_EQ(cup.clusters[0].segments.size(), 6U);
}

TEST(MergeSeenApart, KeepsWhatAnImageShowsApartOrIsElsewhereOrNoThing) {
  CupFromTwoSides seen_together;
  auto& segments = seen_together.clusters[1].segments;
  segments.insert(segments.begin(), {ImageId(2), 8});
  EXPECT_EQ(seen_together.Merge(), 0);
  EXPECT_EQ(CupFromTwoSides(0.12).Merge(), 0);
  CupFromTwoSides stuff;
  for (Cluster& cluster : stuff.clusters) cluster.class_index = 0;
  EXPECT_EQ(stuff.Merge(), 0);
  CupFromTwoSides other_class;
  other_class.clusters[1].class_index = 2;
  EXPECT_EQ(other_class.Merge(), 0);
  ClusterOptions never;
  never.min_in_space = 1.0;
  EXPECT_EQ(CupFromTwoSides().Merge(never), 0);
}

}  // namespace
}  // namespace s3lam
