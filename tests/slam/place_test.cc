#include <gtest/gtest.h>

#include <algorithm>

#include "s3lam/slam/loop_closer.h"
#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

/// A long wall of points along x with some depth, walked along; frame `i` is seen from x = 0.3 i.
class PlaceTest : public ::testing::Test {
 protected:
  PlaceTest() : undistorter_(testing::MakeTestCamera(CameraModel::kPinhole)) {
    Rng rng(3);
    for (int i = 0; i < 3000; ++i) {
      cloud_.points.emplace_back(rng.Uniform(-4.0, 22.0), rng.Uniform(-2.0, 2.0),
                                 rng.Uniform(3.0, 6.0));
      cloud_.descriptors.push_back(testing::MakeDescriptor(rng));
    }
  }

  /// A frame, its descriptors with a few bits wrong, as another look at a place has them.
  void See(const Rigid3& pose) {
    Rng rng(100 + poses_.size());
    testing::PointCloud noisy = cloud_;
    for (BinaryDescriptor& descriptor : noisy.descriptors) {
      for (int flip = 0; flip < 12; ++flip) {
        const auto bit = rng.Below(256);
        descriptor[bit / 8] = static_cast<uint8_t>(descriptor[bit / 8] ^ (1U << (bit % 8)));
      }
    }
    poses_.push_back(pose);
    frames_.push_back(testing::SeeCloud(noisy, pose, undistorter_, 0.3, rng));
    // SeeCloud keeps the order of the points it sees.
    std::vector<int> seen;
    for (int i = 0; i < static_cast<int>(cloud_.points.size()); ++i) {
      const auto pixel = undistorter_.camera().ImageFromCamera(pose * cloud_.points[i]);
      if (pixel && (pixel->array() >= 0.0).all() && pixel->x() <= undistorter_.camera().width &&
          pixel->y() <= undistorter_.camera().height) {
        seen.push_back(i);
      }
    }
    seen_.push_back(seen);
  }

  /// Some points of a place farther on look, and lie, as those of the first place do.
  void HangUpAPosterTwice(double distance = 12.0) {
    const size_t count = cloud_.points.size();
    for (size_t i = 0; i < count; ++i) {
      const Eigen::Vector3d x = cloud_.points[i];
      if (std::abs(x.x() - 1.0) > 0.8 || std::abs(x.y()) > 0.8) continue;
      cloud_.points.emplace_back(x + Eigen::Vector3d(distance, 0.0, 0.0));
      const BinaryDescriptor copy = cloud_.descriptors[i];
      cloud_.descriptors.push_back(copy);
    }
  }

  void Walk(int num_frames) {
    for (int i = 0; i < num_frames; ++i) See(At(0.3 * i));
  }
  static Rigid3 At(double x) { return {Eigen::Quaterniond::Identity(), {-x, 0.0, 0.0}}; }

  /// A map of these frames as keyframes in a world of its own: no point belongs to frames of two
  /// groups.
  void AddGroup(const std::vector<int>& frames, const Similarity3& map_from_truth, Map& map) const {
    std::vector<int> point_of(cloud_.points.size(), kNoIndex);
    for (const int frame : frames) {
      const int keyframe =
          map.AddKeyframe(frame, TransformCameraPose(map_from_truth, poses_[frame]));
      for (int i = 0; i < static_cast<int>(seen_[frame].size()); ++i) {
        int& point = point_of[seen_[frame][i]];
        if (point == kNoIndex) {
          point = map.AddPoint(map_from_truth * cloud_.points[seen_[frame][i]], keyframe);
        }
        map.AddObservation(point, {keyframe, i});
      }
    }
    for (const int point : point_of) {
      if (point == kNoIndex || !map.point(point).alive) continue;
      if (map.point(point).observations.size() < 2) {
        map.ErasePoint(point);
        continue;
      }
      map.UpdateAppearance(point);
      map.UpdateGeometry(point);
    }
  }

  Undistorter undistorter_;
  testing::PointCloud cloud_;
  std::vector<Rigid3> poses_;
  std::vector<FrameFeatures> frames_;
  std::vector<std::vector<int>> seen_;
};

std::vector<int> Range(int begin, int end) {
  std::vector<int> range;
  for (int i = begin; i < end; ++i) range.push_back(i);
  return range;
}

TEST_F(PlaceTest, WordsTellWhichFramesShowTheSamePlace) {
  Walk(60);
  See(At(0.3 * 12));
  const Vocabulary vocabulary({.max_training_descriptors = 20000}, frames_);
  EXPECT_GT(vocabulary.num_words(), 1000U);
  PlaceIndex index(vocabulary);
  for (int i = 0; i < 60; ++i) index.Add(i, vocabulary.Describe(frames_[i]));
  const BagOfWords query = vocabulary.Describe(frames_[60]);
  const auto ranked = index.Rank(query, 3);
  ASSERT_EQ(ranked.size(), 3U);
  for (const auto& [similarity, label] : ranked) EXPECT_NEAR(label, 12, 4);
  std::vector<uint8_t> skip(60, 0);
  skip[12] = 1;
  for (const auto& [similarity, label] : index.Rank(query, 60, skip)) EXPECT_NE(label, 12);
}

TEST_F(PlaceTest, VerificationFindsTheSimilarityBetweenTwoMaps) {
  Walk(12);
  Map a(frames_, {});
  Map b(frames_, {});
  AddGroup(Range(0, 6), {}, a);
  const Similarity3 b_from_truth{
      0.4, QuaternionFromRotationVector({0.1, 0.5, -0.2}), {1.0, 2.0, -1.0}};
  AddGroup(Range(6, 12), b_from_truth, b);
  const auto match = VerifyPlace({}, undistorter_, {&a, 5}, {&b, 0});
  ASSERT_TRUE(match.has_value());
  EXPECT_GE(match->points.size(), 50U);
  const Similarity3 error = match->world_a_from_world_b * b_from_truth;
  EXPECT_NEAR(error.scale, 1.0, 0.01);
  EXPECT_LT((error * Eigen::Vector3d(1.5, 0.0, 4.0) - Eigen::Vector3d(1.5, 0.0, 4.0)).norm(), 0.05);
  for (const auto& [pa, pb] : match->points) {
    EXPECT_LT(
        (a.point(pa).position - error * (b_from_truth.Inverse() * b.point(pb).position)).norm(),
        0.2);
  }
}

TEST_F(PlaceTest, AnotherPlaceIsRefused) {
  Walk(60);
  Map map(frames_, {});
  AddGroup(Range(0, 60), {}, map);
  EXPECT_FALSE(VerifyPlace({}, undistorter_, {&map, 2}, {&map, 50}).has_value());
}

TEST_F(PlaceTest, ARepeatedObjectIsNotTheSamePlace) {
  HangUpAPosterTwice();
  Walk(60);
  Map map(frames_, {});
  AddGroup(Range(0, 60), {}, map);
  EXPECT_FALSE(VerifyPlace({}, undistorter_, {&map, 3}, {&map, 43}).has_value());
}

/// Walks out and back: the way back is known apart, in a world that drifted.
class LoopTest : public PlaceTest {
 protected:
  void WalkOutAndBack() {
    for (int i = 0; i < 40; ++i) See(At(0.3 * i));
    for (int i = 39; i >= 0; --i) See(At(0.3 * i + 0.1));
  }

  /// The chain drifts with every frame; points stay where the first keyframe that saw them puts
  /// them.
  Map MakeDriftingMap() {
    Map map(frames_, {});
    // Two groups that share the turning point's points.
    AddGroup(Range(0, 80), {}, map);
    // Cut what connects the way back with the way out but at the turn.
    const int n = map.num_points();
    for (int p = 0; p < n; ++p) {
      if (!map.point(p).alive) continue;
      const auto observations = map.point(p).observations;
      std::vector<MapObservation> back;
      for (const MapObservation& o : observations) {
        if (o.keyframe >= 48) back.push_back(o);
      }
      if (back.empty() || back.size() == observations.size()) continue;
      const Eigen::Vector3d position = map.point(p).position;
      for (const MapObservation& o : back) map.RemoveObservation(p, o.keyframe);
      if (back.size() < 2) continue;
      const int copy = map.AddPoint(position, back.front().keyframe);
      for (const MapObservation& o : back) map.AddObservation(copy, o);
      map.UpdateAppearance(copy);
      map.UpdateGeometry(copy);
    }
    const auto drift = [](int k) {
      return Similarity3{std::pow(1.003, k),
                         QuaternionFromRotationVector({0.0, 0.0008 * k, 0.0}),
                         {0.0, 0.003 * k, 0.0}};
    };
    for (int p = 0; p < map.num_points(); ++p) {
      if (!map.point(p).alive) continue;
      map.SetPosition(p, drift(map.point(p).observations.front().keyframe) * map.point(p).position);
    }
    for (int k = 0; k < map.num_keyframes(); ++k) {
      map.SetPose(k, TransformCameraPose(drift(k), map.keyframe(k).cam_from_world));
    }
    for (int p = 0; p < map.num_points(); ++p) {
      if (map.point(p).alive) map.UpdateGeometry(p);
    }
    return map;
  }

  /// Distance between the centres of the first and the last keyframe: 0.1 in truth, where the way
  /// is 11.7 long.
  static double GapShare(const Map& map) {
    const auto center = [&](int k) { return map.PoseOf(k).CenterInB(); };
    return (center(0) - center(79)).norm() / (center(0) - center(39)).norm();
  }
};

TEST_F(LoopTest, ClosingALoopTakesTheDriftOut) {
  WalkOutAndBack();
  Map map = MakeDriftingMap();
  ASSERT_GT(GapShare(map), 0.015);
  const Vocabulary vocabulary({}, frames_);
  const MapperOptions mapper_options;
  const Mapper mapper(mapper_options, undistorter_);
  std::vector<FrameTrack> tracks(frames_.size());
  LoopClosingOptions options;
  options.min_frame_gap = 10;
  options.max_lost_share = 1.0;  // The map made by hand is not consistent to begin with.
  const LoopClosingReport report =
      CloseLoops(options, vocabulary, undistorter_, mapper, 3, 1, map, tracks);
  EXPECT_FALSE(report.closed.empty());
  for (const LoopReport& loop : report.closed) {
    EXPECT_NEAR(poses_[loop.frame_a].CenterInB().x(), poses_[loop.frame_b].CenterInB().x(), 3.0);
  }
  EXPECT_NEAR(GapShare(map), 0.1 / 11.7, 0.0005);
}

TEST_F(LoopTest, AFalseLoopIsTornAndDoesNotTakeTrueOnesWithIt) {
  HangUpAPosterTwice(6.0);
  WalkOutAndBack();
  Map map = MakeDriftingMap();
  const Vocabulary vocabulary({}, frames_);
  const MapperOptions mapper_options;
  const Mapper mapper(mapper_options, undistorter_);
  std::vector<FrameTrack> tracks(frames_.size());
  LoopClosingOptions options;
  options.min_frame_gap = 10;
  options.max_lost_share = 1.0;
  options.candidates = 40;
  // Verification that believes the poster.
  options.verification = {.min_pairs = 12, .min_found_share = 0.0, .min_support = 0};
  const LoopClosingReport report =
      CloseLoops(options, vocabulary, undistorter_, mapper, 3, 1, map, tracks);
  EXPECT_GT(report.closed.size(), 10 * static_cast<size_t>(report.num_rejected));
  EXPECT_GT(report.num_rejected, 0);
  EXPECT_NEAR(GapShare(map), 0.1 / 11.7, 0.0005);
}

TEST_F(PlaceTest, LoopsThatTheMapContradictsAreUndone) {
  HangUpAPosterTwice();
  Walk(60);
  Map map(frames_, {});
  AddGroup(Range(0, 60), {}, map);
  const Rigid3 pose_before = map.PoseOf(43);
  const size_t observations = map.NumObservations();
  const Vocabulary vocabulary({.max_training_descriptors = 20000}, frames_);
  const MapperOptions mapper_options;
  const Mapper mapper(mapper_options, undistorter_);
  std::vector<FrameTrack> tracks(frames_.size());
  LoopClosingOptions options;
  // Verification that believes the poster.
  options.verification = {.min_pairs = 12, .min_found_share = 0.0, .min_support = 0};
  const LoopClosingReport report =
      CloseLoops(options, vocabulary, undistorter_, mapper, 3, 1, map, tracks);
  EXPECT_TRUE(report.closed.empty());
  EXPECT_GT(report.num_rejected, 0);
  EXPECT_EQ(map.PoseOf(43).translation, pose_before.translation);
  EXPECT_EQ(map.NumObservations(), observations);
}

}  // namespace
}  // namespace s3lam
