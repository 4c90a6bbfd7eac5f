#include "s3lam/slam/remapping.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <numeric>

#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

/// A camera moving sideways past a cloud of points, and maps with a keyframe at every frame.
class RemappingTest : public ::testing::Test {
 protected:
  RemappingTest() : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)) {
    const testing::PointCloud cloud = testing::MakeCloud(400, /*planar=*/false, 5);
    Rng rng(6);
    for (int i = 0; i < kFrames; ++i) {
      frames_.push_back(testing::SeeCloud(cloud, Truth(i), undistorter_, 0.3, rng));
    }
    vocabulary_ = std::make_unique<Vocabulary>(VocabularyOptions{}, frames_);
  }

  static Rigid3 Truth(int frame) {
    Rigid3 pose;
    pose.translation = Eigen::Vector3d(-0.04 * frame, 0.01 * frame, 0.0);
    return pose;
  }

  /// One map that takes a wrong turn at a frame, and one more at `second`.
  MappedSequence Mapped(int first = kFrames, int second = kFrames) {
    const Rigid3 turn{Eigen::Quaterniond(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitX())),
                      Eigen::Vector3d::Zero()};
    auto builder =
        std::make_unique<MapBuilder>(TrackerOptions{}, MapperOptions{}, FeatureOptions{}, frames_,
                                     undistorter_, *vocabulary_, std::vector<uint8_t>());
    Rigid3 bent;
    for (int i = 0; i < kFrames; ++i) {
      if (i == first || i == second) bent = turn * bent;
      builder->map().AddKeyframe(i, bent * Truth(i));
      builder->tracks()[static_cast<size_t>(i)].tracked = true;
    }
    MappedSequence mapped;
    mapped.maps.push_back(std::move(builder));
    return mapped;
  }

  RemappingReport MapAgain(const MapFrom& map_from, MappedSequence& mapped,
                           const CloseLoopsIn& close_loops = {}) {
    return MapAgainWhereRefuted({}, undistorter_, 1, kFrames, map_from, mapped, close_loops);
  }

  static constexpr int kFrames = 48;
  Undistorter undistorter_;
  std::vector<FrameFeatures> frames_;
  std::unique_ptr<Vocabulary> vocabulary_;
};

TEST_F(RemappingTest, RefutedKeyframesCutAMap) {
  const MappedSequence mapped = Mapped();
  const MapBuilder& builder = *mapped.maps.front();
  std::vector<double> doubts(kFrames, 0.0);
  MapParts parts = FindParts(builder.map(), builder.tracks(), doubts);
  EXPECT_EQ(std::count(parts.of_frame.begin(), parts.of_frame.end(), parts.largest), kFrames);
  std::fill(doubts.begin() + 16, doubts.begin() + 20, 1.0);
  parts = FindParts(builder.map(), builder.tracks(), doubts);
  for (int i = 0; i < kFrames; ++i) {
    EXPECT_EQ(parts.of_frame[static_cast<size_t>(i)] == parts.largest, i >= 20) << i;
  }
}

TEST_F(RemappingTest, ARightMapIsLeftAlone) {
  MappedSequence mapped = Mapped();
  const MapBuilder* const before = mapped.maps.front().get();
  const RemappingReport report = MapAgain(
      [](const FrameSpan&) -> MappedSequence {
        ADD_FAILURE() << "mapped again";
        return {};
      },
      mapped);
  EXPECT_EQ(report.attempts, 0);
  EXPECT_LT(report.doubt_before, 0.05);
  EXPECT_EQ(mapped.maps.front().get(), before);
}

TEST_F(RemappingTest, ABentMapGivesWayToOneFromItsLongestStraightPart) {
  MappedSequence mapped = Mapped(16);
  std::vector<FrameSpan> starts;
  const RemappingReport report = MapAgain(
      [&](const FrameSpan& start) {
        starts.push_back(start);
        MappedSequence again = Mapped();
        again.num_merged = 3;
        return again;
      },
      mapped);
  ASSERT_EQ(starts.size(), 1U);
  EXPECT_GT(starts[0].begin, 16);
  EXPECT_EQ(starts[0].end, kFrames);
  EXPECT_EQ(report.attempts, 1);
  EXPECT_GT(report.doubt_before, 0.2);
  EXPECT_LT(report.doubt, 0.05);
  EXPECT_EQ(mapped.num_merged, 3);
}

TEST_F(RemappingTest, WhatIsNoBetterIsNotTaken) {
  MappedSequence mapped = Mapped(24);
  const MapBuilder* const before = mapped.maps.front().get();
  int calls = 0;
  const RemappingReport report = MapAgain(
      [&](const FrameSpan&) { return ++calls == 1 ? MappedSequence() : Mapped(14, 34); }, mapped);
  EXPECT_EQ(report.attempts, 2);
  EXPECT_EQ(report.doubt, report.doubt_before);
  EXPECT_EQ(mapped.maps.front().get(), before);
}

TEST_F(RemappingTest, LoopsAreClosedBeforeAMapIsGivenUp) {
  MappedSequence mapped = Mapped(16);
  const RemappingReport report = MapAgain(
      [](const FrameSpan&) -> MappedSequence {
        ADD_FAILURE() << "mapped again";
        return {};
      },
      mapped,
      [&](MappedSequence& sequence) {
        sequence = Mapped();
        sequence.loops.resize(1);
      });
  EXPECT_EQ(report.attempts, 0);
  EXPECT_GT(report.doubt_before, 0.2);
  EXPECT_LT(report.doubt, 0.05);
  EXPECT_EQ(mapped.loops.size(), 1U);
}

TEST_F(RemappingTest, LoopsOfOtherStartsAreClosedBeforeTheyAreJudged) {
  MappedSequence mapped = Mapped(24);
  int num_closed = 0;
  const RemappingReport report = MapAgain([&](const FrameSpan&) { return Mapped(14, 34); }, mapped,
                                          [&](MappedSequence& sequence) {
                                            if (++num_closed == 2) sequence = Mapped();
                                          });
  EXPECT_EQ(num_closed, 2);
  EXPECT_EQ(report.attempts, 1);
  EXPECT_LT(report.doubt, 0.05);
}

TEST_F(RemappingTest, LoopsOfAMapWithoutDoubtAreLeftForLater) {
  MappedSequence mapped = Mapped();
  MapAgain([](const FrameSpan&) { return MappedSequence(); }, mapped,
           [](MappedSequence&) { ADD_FAILURE() << "loops closed"; });
}

TEST_F(RemappingTest, ThePairThatAMapWasBegunFromIsNotTriedAgain) {
  MappedSequence mapped = Mapped(16);
  InitialPair pair;
  pair.frame_a = 36;
  pair.frame_b = 38;
  mapped.maps.front()->Start(pair);
  for (const int k : {kFrames, kFrames + 1}) mapped.maps.front()->map().EraseKeyframe(k);
  std::vector<FrameSpan> starts;
  MapAgain(
      [&](const FrameSpan& start) {
        starts.push_back(start);
        return MappedSequence();
      },
      mapped);
  ASSERT_EQ(starts.size(), 2U);
  for (const FrameSpan& start : starts) EXPECT_TRUE(start.end <= 36 || start.begin > 38);
}

TEST_F(RemappingTest, WhereAllIsInDoubtItIsBegunFromOtherFrames) {
  MappedSequence mapped = Mapped();
  for (FrameTrack& track : mapped.maps.front()->tracks()) track.tracked = false;
  std::vector<FrameSpan> starts;
  const RemappingReport report = MapAgain(
      [&](const FrameSpan& start) {
        starts.push_back(start);
        return Mapped();
      },
      mapped);
  EXPECT_EQ(report.doubt_before, 1.0);
  EXPECT_EQ(report.attempts, 1);
  EXPECT_LT(report.doubt, 0.05);
}

TEST_F(RemappingTest, FramesInNoMapAreInDoubt) {
  const MappedSequence mapped = Mapped();
  mapped.maps.front()->tracks()[3].tracked = false;
  const std::vector<double> doubts =
      DoubtsOfFrames({.min_matches = 100}, mapped.maps, undistorter_, 1, kFrames);
  EXPECT_EQ(doubts[3], 1.0);
  EXPECT_LT(doubts[4], 0.5);
}

TEST_F(RemappingTest, FramesBeyondRefutedOnesAreInDoubtUnlessOthersSeePointsOnBothSides) {
  const MappedSequence mapped = Mapped(16);
  const std::vector<double> doubts =
      DoubtsOfFrames({.min_matches = 100}, mapped.maps, undistorter_, 1, kFrames);
  const double refuted = std::accumulate(doubts.begin(), doubts.end(), 0.0) / kFrames;
  ASSERT_LT(doubts[4], 0.5);
  ASSERT_LT(doubts[40], 0.5);
  EXPECT_GT(PartInDoubt(mapped.maps, doubts), refuted + 0.1);
  Map& map = mapped.maps.front()->map();
  constexpr int kEnough = 20;
  for (int p = 0; p < kEnough; ++p) {
    EXPECT_GT(PartInDoubt(mapped.maps, doubts), refuted + 0.1) << p << " points";
    map.AddPoint({0.0, 0.0, 4.0}, 4);
    for (const int k : {4, 40}) ASSERT_TRUE(map.AddObservation(p, {k, p}));
  }
  EXPECT_NEAR(PartInDoubt(mapped.maps, doubts), refuted, 1e-9);
}

}  // namespace
}  // namespace s3lam
