#include "s3lam/semantics/instances.h"

#include <gtest/gtest.h>

#include <map>
#include <set>
#include <vector>

#include "s3lam/base/rng.h"
#include "semantics/semantics_fixture.h"

namespace s3lam {
namespace {

using testing::ObservationBuilder;

TEST(TrackInstances, UsesBothThresholds) {
  ObservationBuilder builder;
  const auto a0 = static_cast<uint32_t>(builder.AddSegment(0, 1));
  const auto b0 = static_cast<uint32_t>(builder.AddSegment(0, 1));
  const auto a1 = static_cast<uint32_t>(builder.AddSegment(1, 1));
  const auto a2 = static_cast<uint32_t>(builder.AddSegment(2, 1));
  const auto b2 = static_cast<uint32_t>(builder.AddSegment(2, 1));
  const auto c2 = static_cast<uint32_t>(builder.AddSegment(2, 1));
  builder.result().overlaps = {{a1, a0, 1, 0.66}, {a1, b0, 1, 0.2},  {a2, a1, 1, 0.64},
                               {a2, a0, 2, 0.41}, {b2, b0, 2, 0.39}, {c2, b0, 2, 0.42}};
  const InstanceAssignment result = TrackInstances(builder.result(), TrackingOptions{});
  const auto& id = result.instance_of_segment;
  EXPECT_EQ(id[a1], id[a0]);
  EXPECT_EQ(id[a2],
            id[a0]);  // 0.64 is not enough for the previous frame, 0.41 is for the one before.
  EXPECT_NE(id[b2], id[b0]);
  EXPECT_EQ(id[c2], id[b0]);
  EXPECT_EQ(result.num_instances, 3);
}

TEST(TrackInstances, GivesAnInstanceToOneSegmentOfAFrame) {
  ObservationBuilder builder;
  const auto a0 = static_cast<uint32_t>(builder.AddSegment(0, 1));
  const auto a1 = static_cast<uint32_t>(builder.AddSegment(1, 1));
  const auto b1 = static_cast<uint32_t>(builder.AddSegment(1, 1));
  builder.result().overlaps = {{a1, a0, 1, 0.7}, {b1, a0, 1, 0.8}};
  const auto id = TrackInstances(builder.result(), TrackingOptions{}).instance_of_segment;
  EXPECT_EQ(id[b1], id[a0]);
  EXPECT_NE(id[a1], id[a0]);
}

/// Objects with points on them, seen by frames whose segments are the objects, except where `merge`
/// says that two objects make one segment.
struct ObjectScene {
  ObservationBuilder builder;
  std::vector<int> object_of_row;
  std::vector<std::set<int>> objects_of_segment;
};

ObjectScene MakeObjectScene(int num_objects, uint32_t num_frames, double merge_rate,
                            uint64_t seed) {
  constexpr int kPointsPerObject = 20;
  constexpr double kVisible = 0.7;
  Rng rng(seed);
  ObjectScene scene;
  std::vector<std::map<int, int32_t>> segment_of(num_frames);
  for (uint32_t f = 0; f < num_frames; ++f) {
    const bool merges = rng.Uniform() < merge_rate;
    const int first = static_cast<int>(rng.Below(static_cast<uint64_t>(num_objects)));
    const int second = (first + 1) % num_objects;
    for (int o = 0; o < num_objects; ++o) {
      if (merges && o == second && segment_of[f].contains(first)) {
        segment_of[f][o] = segment_of[f].at(first);
      } else {
        segment_of[f][o] = scene.builder.AddSegment(f, static_cast<int>(rng.Below(3)));
        scene.objects_of_segment.emplace_back();
      }
      scene.objects_of_segment[static_cast<size_t>(segment_of[f].at(o))].insert(o);
    }
  }
  for (int o = 0; o < num_objects; ++o) {
    for (int p = 0; p < kPointsPerObject; ++p) {
      std::vector<int32_t> segments;
      for (uint32_t f = 0; f < num_frames; ++f) {
        if (rng.Uniform() < kVisible) segments.push_back(segment_of[f].at(o));
      }
      if (segments.empty()) continue;
      scene.builder.AddPoint(segments);
      scene.object_of_row.push_back(o);
    }
  }
  return scene;
}

/// By the number of frames joined at first: all of them, or runs of a few.
class ByWindow : public ::testing::TestWithParam<int> {
 protected:
  [[nodiscard]] static ConsensusOptions Options() {
    ConsensusOptions options;
    options.window = GetParam();
    return options;
  }
};
INSTANTIATE_TEST_SUITE_P(Windows, ByWindow, ::testing::Values(128, 5, 1));

TEST_P(ByWindow, FindsObjectsWithoutHelpFromClasses) {
  ObjectScene scene = MakeObjectScene(5, 12, 0.0, 1);
  const InstanceAssignment result = ClusterByConsensus(scene.builder.result(), Options(), 2);
  EXPECT_EQ(result.num_instances, 5);
  std::map<int, std::set<int32_t>> instances;
  for (size_t s = 0; s < scene.objects_of_segment.size(); ++s) {
    instances[*scene.objects_of_segment[s].begin()].insert(result.instance_of_segment[s]);
  }
  for (const auto& [object, found] : instances) EXPECT_EQ(found.size(), 1U) << object;
}

TEST_P(ByWindow, OutvotesMergedSegments) {
  ObjectScene scene = MakeObjectScene(5, 20, 0.3, 2);
  const InstanceAssignment result = ClusterByConsensus(scene.builder.result(), Options(), 2);
  std::map<int, std::set<int32_t>> instances;
  std::set<int32_t> all;
  int merged = 0;
  for (size_t s = 0; s < scene.objects_of_segment.size(); ++s) {
    if (scene.objects_of_segment[s].size() > 1) {
      ++merged;
      continue;
    }
    instances[*scene.objects_of_segment[s].begin()].insert(result.instance_of_segment[s]);
    all.insert(result.instance_of_segment[s]);
  }
  EXPECT_GT(merged, 2);
  EXPECT_EQ(all.size(), 5U);
  for (const auto& [object, found] : instances) EXPECT_EQ(found.size(), 1U) << object;
}

TEST(ClusterByConsensus, TwoSegmentsOfAFrameAreTwoObjects) {
  ObservationBuilder builder;
  const int32_t a = builder.AddSegment(0, 1);
  const int32_t b = builder.AddSegment(0, 1);
  const int32_t both = builder.AddSegment(1, 1);
  for (int i = 0; i < 10; ++i) builder.AddPoint({a, both});
  for (int i = 0; i < 9; ++i) builder.AddPoint({b, both});
  const auto id = ClusterByConsensus(builder.result(), ConsensusOptions{}, 2).instance_of_segment;
  EXPECT_NE(id[0], id[1]);
}

TEST(ClusterByConsensus, AMissedObjectDoesNotTakeWhatSurroundsIt) {
  // Frames 0 to 2 see one end of a wall, frames 4 to 6 a sheet on it and the other end. Frame 3,
  // which sees more of the sheet than of either end, takes all for wall.
  ObservationBuilder builder;
  std::vector<int32_t> wall;
  std::vector<int32_t> end;
  std::vector<int32_t> sheet;
  for (uint32_t f = 0; f < 3; ++f) wall.push_back(builder.AddSegment(f, 0));
  const int32_t both = builder.AddSegment(3, 0);
  for (uint32_t f = 4; f < 7; ++f) {
    sheet.push_back(builder.AddSegment(f, 1));
    end.push_back(builder.AddSegment(f, 0));
  }
  for (int i = 0; i < 12; ++i) {
    builder.AddPoint({wall[0], wall[1], wall[2], both});
    builder.AddPoint({both, end[0], end[1], end[2]});
  }
  for (int i = 0; i < 20; ++i) builder.AddPoint({both, sheet[0], sheet[1], sheet[2]});
  ConsensusOptions options;
  const auto id = ClusterByConsensus(builder.result(), options, 2).instance_of_segment;
  EXPECT_EQ(id[wall[0]], id[both]);
  EXPECT_EQ(id[sheet[0]], id[sheet[2]]);
  EXPECT_NE(id[sheet[0]], id[both]);
  options.other_class_weight = 1.0;
  const auto blind = ClusterByConsensus(builder.result(), options, 2).instance_of_segment;
  EXPECT_EQ(blind[sheet[0]], blind[wall[0]]);
}

TEST(ClusterByConsensus, DoesNotDependOnTheOrderOfFrames) {
  // Three views of two objects; the middle view of the first object is what links its ends.
  const auto cluster = [](const std::vector<uint32_t>& order) {
    ObservationBuilder builder;
    std::vector<std::vector<int32_t>> segments(3);
    for (uint32_t f = 0; f < 3; ++f) {
      segments[order[f]] = {builder.AddSegment(f, 1), builder.AddSegment(f, 1)};
    }
    for (int i = 0; i < 10; ++i) {
      for (size_t o = 0; o < 2; ++o) {
        builder.AddPoint({segments[0][o], segments[1][o]});
        builder.AddPoint({segments[1][o], segments[2][o]});
      }
    }
    const auto id = ClusterByConsensus(builder.result(), ConsensusOptions{}, 2).instance_of_segment;
    std::vector<bool> same;
    for (const size_t o : {0U, 1U}) {
      for (const size_t v : {1U, 2U}) {
        same.push_back(id[static_cast<size_t>(segments[0][o])] ==
                       id[static_cast<size_t>(segments[v][o])]);
      }
    }
    same.push_back(id[0] == id[1]);
    return same;
  };
  const std::vector<bool> expected = {true, true, true, true, false};
  EXPECT_EQ(cluster({0, 1, 2}), expected);
  EXPECT_EQ(cluster({2, 0, 1}), expected);
  EXPECT_EQ(cluster({1, 2, 0}), expected);
}

TEST(ClusterByConsensus, IgnoresCrowds) {
  ObservationBuilder builder;
  const int32_t crowd = builder.AddSegment(0, 1);
  const int32_t thing = builder.AddSegment(0, 1);
  builder.result().segments[0].label.is_crowd = true;
  for (int i = 0; i < 10; ++i) {
    builder.AddPoint({crowd});
    builder.AddPoint({thing});
  }
  const InstanceAssignment result = ClusterByConsensus(builder.result(), ConsensusOptions{}, 2);
  EXPECT_EQ(result.num_instances, 1);
  EXPECT_EQ(result.instance_of_segment[0], kNoInstance);
  EXPECT_EQ(result.instance_of_segment[1], 0);
}

TEST(ClusterByConsensus, NothingInNothingOut) {
  EXPECT_EQ(ClusterByConsensus(MaskObservations{}, ConsensusOptions{}, 2).num_instances, 0);
}

}  // namespace
}  // namespace s3lam
