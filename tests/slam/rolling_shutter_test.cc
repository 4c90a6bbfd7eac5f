#include "s3lam/slam/rolling_shutter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "slam/slam_fixture.h"

namespace s3lam {
namespace {

constexpr double kInterval = 1.0 / 30.0;

/// A hand-held camera, of which no polynomial is exact.
Rigid3 CamFromWorld(double time_s) {
  return {QuaternionFromRotationVector({0.1 * std::sin(9.0 * time_s), 0.2 * std::sin(5.0 * time_s),
                                        0.1 * std::cos(7.0 * time_s)}),
          {0.5 * std::sin(2.0 * time_s), 0.1 * std::cos(8.0 * time_s), 0.1 * time_s}};
}

std::vector<double> Times(int count) {
  std::vector<double> times;
  for (int i = 0; i < count; ++i) times.push_back(kInterval * i);
  return times;
}

std::vector<FrameTrack> Tracks(int count) {
  std::vector<FrameTrack> tracks(static_cast<size_t>(count));
  for (int i = 0; i < count; ++i) {
    tracks[i].tracked = true;
    tracks[i].cam_from_world = CamFromWorld(kInterval * i);
  }
  return tracks;
}

TEST(Readout, HasADirection) {
  for (const auto direction : {ShutterDirection::kDown, ShutterDirection::kUp,
                               ShutterDirection::kRight, ShutterDirection::kLeft}) {
    const Readout readout = MakeReadout(0.02, direction);
    EXPECT_EQ(readout.norm(), 0.02);
    EXPECT_EQ(DirectionOf(readout), direction);
  }
  EXPECT_GT(MakeReadout(0.02, ShutterDirection::kRight).x(), 0.0);
  EXPECT_GT(MakeReadout(0.02, ShutterDirection::kDown).y(), 0.0);
}

TEST(FrameMotion, TellsWhereTheCameraHasAPointBetweenFrames) {
  const auto motions = FindMotions(Times(9), Tracks(9));
  const Eigen::Vector3d point(0.4, -0.3, 3.0);
  for (int i = 0; i < 9; ++i) {
    ASSERT_TRUE(motions[i].has_value());
    const double time_s = kInterval * i;
    const bool is_inside = i >= 2 && i < 7;  // With two frames on either side.
    const Eigen::Vector3d exact = CamFromWorld(time_s + 0.012) * point;
    EXPECT_LT((motions[i]->PointAfter(0.012, point) - exact).norm(), is_inside ? 2e-4 : 1e-2);
    EXPECT_LT((motions[i]->PointAfter(0.0, point) - CamFromWorld(time_s) * point).norm(), 1e-12);
    const Eigen::Vector3d step =
        CamFromWorld(time_s + 1e-5) * point - CamFromWorld(time_s - 1e-5) * point;
    EXPECT_LT((motions[i]->VelocityOf(point) - step / 2e-5).norm(), is_inside ? 0.02 : 0.6);
  }
}

TEST(FrameMotion, IsNotToldAcrossGaps) {
  std::vector<FrameTrack> tracks = Tracks(8);
  tracks[2].tracked = false;
  tracks[4].tracked = false;
  std::vector<double> times = Times(8);
  for (int i = 6; i < 8; ++i) times[i] += 1.0;
  const auto motions = FindMotions(times, tracks);
  for (const int i : {2, 3, 4, 5}) EXPECT_FALSE(motions[i].has_value()) << i;
  for (const int i : {0, 1, 6, 7}) EXPECT_TRUE(motions[i].has_value()) << i;
}

/// Points that a camera with a rolling shutter sees in every frame, each a keyframe.
class RollingShutterTest : public ::testing::TestWithParam<ShutterDirection> {
 protected:
  static constexpr int kFrames = 12;
  static constexpr double kReadout = 0.025;

  RollingShutterTest()
      : undistorter_(testing::MakeTestCamera(CameraModel::kOpenCv)),
        cloud_(testing::MakeCloud(400, false, 5)),
        tracks_(Tracks(kFrames)) {
    for (int i = 0; i < kFrames; ++i) frames_.push_back(See(kInterval * i));
    map_.emplace(frames_, FeatureOptions{});
    for (const Eigen::Vector3d& point : cloud_.points) map_->AddPoint(point, 0);
    for (int i = 0; i < kFrames; ++i) {
      map_->AddKeyframe(i, CamFromWorld(kInterval * i));
      for (size_t k = 0; k < points_[i].size(); ++k) {
        map_->AddObservation(points_[i][k], {i, static_cast<int>(k)});
        tracks_[i].matches.push_back({static_cast<int>(k), points_[i][k]});
      }
    }
    motions_ = FindMotions(Times(kFrames), tracks_);
  }

  [[nodiscard]] static Readout readout() { return MakeReadout(kReadout, GetParam()); }

  /// What the camera sees of a point in a frame, the time of whose middle is given.
  [[nodiscard]] std::optional<Eigen::Vector2d> PixelOf(const Eigen::Vector3d& point,
                                                       double time_s) const {
    const Camera& camera = undistorter_.camera();
    auto pixel = camera.ImageFromCamera(CamFromWorld(time_s) * point);
    for (int i = 0; i < 10 && pixel; ++i) {
      const Eigen::Vector2d from_middle(pixel->x() / camera.width - 0.5,
                                        pixel->y() / camera.height - 0.5);
      pixel = camera.ImageFromCamera(CamFromWorld(time_s + readout().dot(from_middle)) * point);
    }
    if (pixel &&
        (pixel->minCoeff() < 0.0 || pixel->x() > camera.width || pixel->y() > camera.height)) {
      return std::nullopt;
    }
    return pixel;
  }

  FrameFeatures See(double time_s) {
    std::vector<Keypoint> keypoints;
    std::vector<BinaryDescriptor> descriptors;
    points_.emplace_back();
    for (size_t p = 0; p < cloud_.points.size(); ++p) {
      const auto pixel = PixelOf(cloud_.points[p], time_s);
      const auto undistorted = pixel ? undistorter_.Undistort(*pixel) : std::nullopt;
      if (!undistorted) continue;
      Keypoint keypoint;
      keypoint.pixel = pixel->cast<float>();
      keypoint.undistorted = undistorted->cast<float>();
      keypoint.sigma = 20.0F;  // Far from an outlier.
      keypoints.push_back(keypoint);
      descriptors.push_back(cloud_.descriptors[p]);
      points_.back().push_back(static_cast<int>(p));
    }
    return {std::move(keypoints), std::move(descriptors), undistorter_};
  }

  [[nodiscard]] MapInMotion map_in_motion() const { return {*map_, motions_}; }
  /// From where a global shutter would have it [px].
  [[nodiscard]] double WorstDistance(int frame) const {
    double worst = 0.0;
    for (const PointMatch& match : tracks_[frame].matches) {
      const auto pixel = undistorter_.camera().ImageFromCamera(tracks_[frame].cam_from_world *
                                                               cloud_.points[match.point]);
      worst = std::max(
          worst, (frames_[frame].keypoint(match.keypoint).pixel.cast<double>() - *pixel).norm());
    }
    return worst;
  }

  Undistorter undistorter_;
  testing::PointCloud cloud_;
  std::vector<std::vector<int>> points_;  // By frame, by keypoint.
  std::vector<FrameFeatures> frames_;
  std::optional<Map> map_;
  std::vector<FrameTrack> tracks_;
  std::vector<std::optional<FrameMotion>> motions_;
};
INSTANTIATE_TEST_SUITE_P(Directions, RollingShutterTest,
                         ::testing::Values(ShutterDirection::kDown, ShutterDirection::kUp,
                                           ShutterDirection::kRight, ShutterDirection::kLeft));

TEST_P(RollingShutterTest, ExplainsTheErrorsAlongItsAxis) {
  const ReadoutShares shares = FindReadoutShares(undistorter_, {map_in_motion()});
  const bool along_x = std::abs(readout().x()) > 0.0;
  const double share = along_x ? shares.right : shares.down;
  EXPECT_GT(share, 0.9);
  EXPECT_LT(along_x ? shares.down : shares.right, 0.5 * share);
}

TEST_P(RollingShutterTest, IsFoundWithPosesAndPointsFree) {
  const Eigen::Vector2d axis = readout().cwiseAbs() / kReadout;
  const auto refined = RefineReadout({}, undistorter_.camera(),
                                     MakeReadoutProblem(undistorter_, map_in_motion(), axis));
  ASSERT_TRUE(refined.has_value());
  EXPECT_NEAR(refined->readout_s, readout().sum(), 0.04 * kReadout);
  EXPECT_GT(refined->sigma_s, 0.0);
  EXPECT_GT(refined->cost_decrease, 0.9);
  EXPECT_FALSE(RefineReadout({}, undistorter_.camera(), {}).has_value());
}

TEST_P(RollingShutterTest, IsUndone) {
  std::vector<double> before;
  for (int i = 0; i < kFrames; ++i) before.push_back(WorstDistance(i));
  EXPECT_GT(before[5], 2.0);
  const double most = *std::max_element(before.begin(), before.end());
  const ShutterCorrection correction(*map_, frames_.size());
  for (int round = 0; round < 2; ++round) {  // From where they were found, not on top.
    correction.Apply(readout(), undistorter_, tracks_, motions_, *map_);
    EXPECT_LT(WorstDistance(5), 0.02 * before[5]);
    for (int i = 0; i < kFrames; ++i) {
      const bool is_inside = i >= 2 && i < kFrames - 2;  // With two frames on either side.
      EXPECT_LT(WorstDistance(i), (is_inside ? 0.03 : 0.2) * most) << i;
    }
  }
  correction.Apply(Readout::Zero(), undistorter_, tracks_, motions_, *map_);
  for (int i = 0; i < kFrames; ++i) EXPECT_NEAR(WorstDistance(i), before[i], 1e-3);
}

}  // namespace
}  // namespace s3lam
