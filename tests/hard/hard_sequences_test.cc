#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "s3lam/eval/trajectory_error.h"
#include "s3lam/slam/pipeline.h"
#include "s3lam/synthetic/render.h"

/// Sequences as people record them: something is in the way, missing or repeated. Whatever comes
/// out must be right; what is lost must be said.
namespace s3lam {
namespace {

struct Frame {
  cv::Mat image;
  Rigid3 world_from_camera;
};
using Frames = std::vector<Frame>;

/// A quarter of the pixels, so that the tests are quick.
Scene MakeSmallScene(const std::string& name, uint64_t seed) {
  SceneOptions options;
  options.speed = 2.0;
  Scene scene = MakeScene(name, seed, options);
  scene.camera.width /= 2;
  scene.camera.height /= 2;
  for (size_t i = 0; i < 4; ++i) scene.camera.params[i] /= 2.0;
  scene.imaging.color = false;
  return scene;
}

Frames RenderAll(const Scene& scene, int num_frames) {
  const Renderer renderer(scene, 2);
  Frames frames;
  for (int i = 0; i < num_frames; ++i) {
    const RenderedFrame rendered = renderer.Render(i);
    frames.push_back({rendered.image, rendered.world_from_camera});
  }
  return frames;
}

struct Scenes {
  Scene room = MakeSmallScene("room", 3);
  Frames walk = RenderAll(room, 150);
};
const Scenes& Rendered() {
  static const Scenes scenes;
  return scenes;
}

slam::Result RunOn(const Camera& camera, const Frames& frames, const slam::Options& given = {},
                   std::optional<FocalPrior> focal_prior = std::nullopt) {
  slam::Input input;
  input.camera = camera;
  input.focal_prior = focal_prior;
  for (size_t i = 0; i < frames.size(); ++i) {
    input.times_s.push_back(static_cast<double>(i) / 30.0);
    input.names.push_back(fmt::format("{:06}.png", i));
  }
  input.read_gray = [&](size_t i) { return frames[i].image.clone(); };
  input.read_color = input.read_gray;
  slam::Options options = given;
  options.num_threads = 2;
  return slam::Run(options, input);
}
slam::Result RunOn(const Frames& frames) { return RunOn(Rendered().room.camera, frames); }

Trajectory Truth(const Frames& frames) {
  Trajectory truth;
  for (size_t i = 0; i < frames.size(); ++i) {
    truth.push_back({static_cast<double>(i) / 30.0, frames[i].world_from_camera});
  }
  return truth;
}

/// Its error is below 1 % of its path. Trajectories of one place are not compared: what does not
/// move has no shape.
bool IsRight(const Trajectory& trajectory, const Trajectory& truth) {
  constexpr double kPlaceM = 0.01;
  const auto errors = CompareTrajectories(trajectory, truth, {.max_dt_s = 0.001});
  return errors && (errors->path_length < kPlaceM ||
                    errors->ate_translation.rmse < 0.01 * errors->path_length);
}

/// No frame is in two maps, and the stretches tell of all frames.
void ExpectWholeReport(const slam::Result& result, const Frames& frames) {
  size_t localized = 0;
  for (const slam::Model& model : result.models) localized += model.frames.size();
  EXPECT_LE(localized, frames.size());
  const auto marked = std::count_if(result.report.frames.begin(), result.report.frames.end(),
                                    [](const auto& frame) { return frame.localized(); });
  EXPECT_EQ(static_cast<size_t>(marked), localized);
  int next = 0;
  for (const slam::StretchReport& stretch : result.report.stretches) {
    EXPECT_EQ(stretch.first_frame, next);
    next = stretch.last_frame + 1;
  }
  EXPECT_EQ(next, static_cast<int>(frames.size()));
}

/// And every map is right within itself.
void ExpectHonest(const slam::Result& result, const Frames& frames) {
  for (const slam::Model& model : result.models) {
    EXPECT_TRUE(IsRight(model.frames, Truth(frames))) << model.frames.size() << " frames";
  }
  ExpectWholeReport(result, frames);
}

/// A map may be wrong where the report says so: stretches that count as good are right, each within
/// itself, and a map that is wrong as a whole has weak ones.
void ExpectWrongOnlyWhereSaid(const slam::Result& result, const Frames& frames) {
  constexpr int kMinLength = 15;  // Frames: shorter ones hardly have a shape.
  using State = slam::StretchReport::State;
  const Trajectory truth = Truth(frames);
  for (size_t m = 0; m < result.models.size(); ++m) {
    int weak = 0;
    for (const slam::StretchReport& stretch : result.report.stretches) {
      if (stretch.map != static_cast<int>(m)) continue;
      weak += stretch.state == State::kWeak ? 1 : 0;
      if (stretch.state != State::kGood) continue;
      Trajectory part;
      for (const TimedPose& pose : result.models[m].frames) {
        const auto frame = static_cast<int>(std::lround(pose.time_s * 30.0));
        if (frame >= stretch.first_frame && frame <= stretch.last_frame) part.push_back(pose);
      }
      EXPECT_TRUE(static_cast<int>(part.size()) < kMinLength || IsRight(part, truth))
          << stretch.first_frame << " to " << stretch.last_frame;
    }
    EXPECT_TRUE(weak > 0 || IsRight(result.models[m].frames, truth)) << "map " << m;
  }
  ExpectWholeReport(result, frames);
}

bool IsLocalized(const slam::Result& result, int frame) {
  return result.report.frames[static_cast<size_t>(frame)].localized();
}

int CountLocalized(const slam::Result& result) {
  return static_cast<int>(std::count_if(result.report.frames.begin(), result.report.frames.end(),
                                        [](const auto& frame) { return frame.localized(); }));
}

TEST(HardSequence, BlackFramesInTheMiddleAreLostAndNothingElse) {
  Frames frames = Rendered().walk;
  for (size_t i = 70; i < 90; ++i) {
    frames[i].image = cv::Mat(frames[i].image.size(), frames[i].image.type(), cv::Scalar(0));
  }
  const slam::Result result = RunOn(frames);
  ExpectHonest(result, frames);
  for (int i = 70; i < 90; ++i) EXPECT_FALSE(IsLocalized(result, i)) << i;
  EXPECT_EQ(CountLocalized(result), 130);
  EXPECT_LE(result.models.size(), 2U);
}

TEST(HardSequence, AJumpIsBridgedWhereTheViewsOverlapAndElseMakesAMapOfItsOwn) {
  Frames frames = Rendered().walk;
  frames.erase(frames.begin() + 60, frames.begin() + 100);
  const slam::Result result = RunOn(frames);
  ExpectHonest(result, frames);
  EXPECT_GE(CountLocalized(result), 105);
  EXPECT_LE(result.models.size(), 2U);
}

TEST(HardSequence, AStopAndADuplicateAreNoMotion) {
  Frames frames(Rendered().walk.begin(), Rendered().walk.begin() + 100);
  const Frame stop = frames[60];
  frames.insert(frames.begin() + 60, 40, stop);
  frames.insert(frames.begin() + 20, frames[20]);
  const slam::Result result = RunOn(frames);
  ExpectHonest(result, frames);
  EXPECT_EQ(CountLocalized(result), static_cast<int>(frames.size()));
  EXPECT_EQ(result.models.size(), 1U);
  ASSERT_EQ(result.report.stops.size(), 1U);  // The duplicate at 20 is too short to be one.
  EXPECT_EQ(result.report.stops[0].kind, slam::StopReport::Kind::kStandstill);
  EXPECT_NEAR(result.report.stops[0].first_frame, 61, 1);
  EXPECT_NEAR(result.report.stops[0].last_frame, 101, 1);
}

TEST(HardSequence, FramesOutOfOrderAreRecognised) {
  Frames frames(Rendered().walk.begin(), Rendered().walk.begin() + 120);
  std::swap(frames[30], frames[50]);
  std::rotate(frames.begin() + 70, frames.begin() + 85, frames.begin() + 100);
  const slam::Result result = RunOn(frames);
  ExpectHonest(result, frames);
  EXPECT_GE(CountLocalized(result), 115);
  EXPECT_EQ(result.models.size(), 1U);
}

TEST(HardSequence, StrongChangesOfExposureAreFollowed) {
  Frames frames(Rendered().walk.begin(), Rendered().walk.begin() + 120);
  for (size_t i = 40; i < frames.size(); ++i) {
    const double gain = i < 70 ? 0.35 : i < 90 ? 1.0 : 1.7;
    cv::Mat changed;
    frames[i].image.convertTo(changed, -1, gain);
    frames[i].image = changed;
  }
  const slam::Result result = RunOn(frames);
  ExpectHonest(result, frames);
  EXPECT_GE(CountLocalized(result), 115);
  EXPECT_EQ(result.models.size(), 1U);
}

TEST(HardSequence, WhereALargeObjectPassingByTakesTheMapAlongTheReportSaysSo) {
  Frames frames = Rendered().walk;
  const int width = frames[0].image.cols;
  const int height = frames[0].image.rows;
  cv::Mat object;  // As rich in corners as the scene: a picture of it, enlarged.
  cv::resize(frames[0].image(cv::Rect(0, 0, width / 2, height / 2)), object,
             cv::Size(width / 2, height));
  for (int i = 0; i < 60; ++i) {  // Two seconds.
    const int left = width - (i + 1) * (width + width / 2) / 60;
    const cv::Rect place = cv::Rect(left, 0, width / 2, height) & cv::Rect(0, 0, width, height);
    Frame& frame = frames[static_cast<size_t>(50 + i)];
    frame.image = frame.image.clone();
    if (place.area() > 0) {
      object(cv::Rect(place.x - left, 0, place.width, height)).copyTo(frame.image(place));
    }
  }
  const slam::Result result = RunOn(frames);
  ExpectWrongOnlyWhereSaid(result, frames);
  EXPECT_TRUE(IsLocalized(result, 30));
  EXPECT_TRUE(IsLocalized(result, 130));
}

TEST(HardSequence, TwoSequencesInOneFolderGiveTwoMaps) {
  Frames frames(Rendered().walk.begin(), Rendered().walk.begin() + 80);
  Scene other = MakeSmallScene("posters", 8);
  other.camera = Rendered().room.camera;
  const Frames more = RenderAll(other, 80);
  frames.insert(frames.end(), more.begin(), more.end());
  const slam::Result result = RunOn(frames);
  ASSERT_EQ(result.models.size(), 2U);
  ExpectHonest(result, frames);
  EXPECT_GE(CountLocalized(result), 155);
  for (int i = 0; i < 160; ++i) {
    const slam::FrameReport& frame = result.report.frames[static_cast<size_t>(i)];
    const int map_of_part = result.report.frames[i < 80 ? 40U : 120U].map;
    EXPECT_TRUE(!frame.localized() || frame.map == map_of_part) << i;
  }
  EXPECT_NE(result.report.frames[40].map, result.report.frames[120].map);
}

/// The room's path with a stop of the position at `stop` (a share of the way), where the camera
/// turns by `turn_rad` and back.
Scene WithTurn(double stop, double turn_rad) {
  Scene scene = MakeSmallScene("room", 3);
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3d> targets;
  const auto add = [&](double time_s, double yaw) {
    const Rigid3 pose = scene.path.WorldFromCamera(time_s);
    const Eigen::Vector3d forward = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                                    (pose.rotation * Eigen::Vector3d::UnitZ());
    positions.push_back(pose.translation);
    targets.emplace_back(pose.translation + 2.0 * forward);
  };
  constexpr int kKnots = 12;
  constexpr int kTurnKnots = 12;
  const int stop_knot = static_cast<int>(stop * kKnots);
  for (int i = 0; i < kKnots; ++i) {
    const double time_s = 0.2 * i;
    if (i == stop_knot) {
      for (int k = 0; k < 3; ++k) add(time_s, 0.0);
      for (int k = 0; k <= kTurnKnots; ++k) {
        add(time_s, turn_rad * std::sin(std::numbers::pi * k / kTurnKnots));
      }
      for (int k = 0; k < 2; ++k) add(time_s, 0.0);
    }
    add(time_s, 0.0);
  }
  const double duration_s = 0.2 * static_cast<double>(positions.size());
  scene.path = CameraPath(positions, targets, duration_s, Shake{}, 1);
  scene.num_frames = static_cast<int>(duration_s * scene.fps);
  return scene;
}

/// A hand that shakes, and lines that are exposed one after another.
class RollingShutter : public ::testing::Test {
 protected:
  RollingShutter() : scene_(MakeSmallScene("desk", 2)) { scene_.imaging.readout_time_s = 0.025; }

  slam::Result Run(const Camera& camera, const Frames& frames,
                   RollingShutterOptions::Mode mode) const {
    slam::Options options;
    options.rolling_shutter.mode = mode;
    return RunOn(camera, frames, options);
  }
  static double ErrorOf(const slam::Result& result, const Frames& frames) {
    const auto errors =
        CompareTrajectories(result.models[0].frames, Truth(frames), {.max_dt_s = 0.001});
    return errors ? errors->ate_translation.rmse : std::numeric_limits<double>::infinity();
  }
  /// Seen unless it is corrected, and corrected for the better.
  void ExpectCorrected(const Camera& camera, const Frames& frames,
                       ShutterDirection direction) const {
    const slam::Result as_is = Run(camera, frames, RollingShutterOptions::Mode::kCheck);
    EXPECT_TRUE(as_is.report.rolling_shutter->is_seen);
    EXPECT_FALSE(as_is.report.rolling_shutter->is_compensated);
    const slam::Result result = Run(camera, frames, RollingShutterOptions::Mode::kCompensate);
    const slam::RollingShutterReport& report = *result.report.rolling_shutter;
    EXPECT_TRUE(report.is_compensated);
    EXPECT_EQ(report.direction, direction);
    EXPECT_NEAR(report.readout_s, scene_.imaging.readout_time_s, 0.002);
    EXPECT_LT(ErrorOf(result, frames), 0.4 * ErrorOf(as_is, frames));
    EXPECT_EQ(CountLocalized(result), static_cast<int>(frames.size()));
  }

  Scene scene_;
};

TEST_F(RollingShutter, IsSeenAndCorrected) {
  ExpectCorrected(scene_.camera, RenderAll(scene_, 90), ShutterDirection::kDown);
}

TEST_F(RollingShutter, OfACameraHeldUprightIsCorrectedAlongTheColumns) {
  // The image turned clockwise: what was its upper edge is at the right.
  Frames frames = RenderAll(scene_, 90);
  for (Frame& frame : frames) {
    cv::rotate(frame.image, frame.image, cv::ROTATE_90_CLOCKWISE);
    const Eigen::Quaterniond turn(
        Eigen::AngleAxisd(-std::numbers::pi / 2.0, Eigen::Vector3d::UnitZ()));
    frame.world_from_camera.rotation = frame.world_from_camera.rotation * turn;
  }
  Camera camera = scene_.camera;
  std::swap(camera.width, camera.height);
  std::swap(camera.params[0], camera.params[1]);
  camera.params[2] = scene_.camera.height - scene_.camera.params[3];
  camera.params[3] = scene_.camera.params[2];
  ExpectCorrected(camera, frames, ShutterDirection::kLeft);
}

TEST_F(RollingShutter, IsNotSeenInAGlobalOne) {
  const Frames frames(Rendered().walk.begin(), Rendered().walk.begin() + 90);
  const slam::Result result =
      Run(Rendered().room.camera, frames, RollingShutterOptions::Mode::kCompensate);
  EXPECT_FALSE(result.report.rolling_shutter->is_seen);
  EXPECT_FALSE(result.report.rolling_shutter->is_compensated);
  EXPECT_LT(result.report.rolling_shutter->cost_share, 0.0003);
}

/// With keyframes too far apart, what turns into view has no points to hold it.
class BentMap : public ::testing::Test {
 protected:
  BentMap() { options_.tracker.min_coverage = 0.0; }
  [[nodiscard]] slam::Result Run() const {
    return RunOn(Rendered().room.camera, frames_, options_);
  }

  const Frames frames_{Rendered().walk.begin() + 50, Rendered().walk.end()};
  slam::Options options_;
};

TEST_F(BentMap, IsNotPassedOffAsGood) {
  options_.remapping.max_attempts = 0;
  const slam::Result result = Run();
  ASSERT_EQ(result.models.size(), 1U);
  ASSERT_FALSE(IsRight(result.models[0].frames, Truth(frames_))) << "the test needs a worse case";
  const auto weak = std::count_if(result.report.frames.begin(), result.report.frames.end(),
                                  [](const slam::FrameReport& f) { return f.trust < 0.5; });
  EXPECT_GE(weak, 10);
}

TEST_F(BentMap, GivesWayToOneFromAnotherStart) {
  const slam::Result result = Run();
  EXPECT_GE(result.report.remapping.attempts, 1);
  EXPECT_GT(result.report.remapping.doubt_before, 0.2);
  EXPECT_LT(result.report.remapping.doubt, 0.05);
  ExpectHonest(result, frames_);
  EXPECT_GE(CountLocalized(result), 98);
}

class Turn : public ::testing::TestWithParam<std::pair<double, double>> {};
INSTANTIATE_TEST_SUITE_P(HardSequence, Turn,
                         ::testing::Values(std::pair(0.0, 0.4), std::pair(0.5, 0.4),
                                           std::pair(0.5, 1.5)));

TEST_P(Turn, OnTheSpotIsNotTakenForAMotion) {
  const auto [stop, turn_rad] = GetParam();
  const Scene scene = WithTurn(stop, turn_rad);
  const Frames frames = RenderAll(scene, scene.num_frames);
  const slam::Result result = RunOn(scene.camera, frames);
  ExpectHonest(result, frames);
  EXPECT_GE(CountLocalized(result), static_cast<int>(frames.size()) / 2);
  EXPECT_EQ(result.models.size(), 1U);
  EXPECT_TRUE(std::any_of(result.report.stops.begin(), result.report.stops.end(),
                          [](const auto& s) {
                            return s.kind == slam::StopReport::Kind::kRotation && s.turn_deg > 2.0;
                          }))
      << "no turn on the spot is told";
}

TEST(HardSequence, ACameraThatIsNotKnownIsFound) {
  const Camera& truth = Rendered().room.camera;
  Camera guess = truth;
  guess.model = CameraModel::kRadial;
  guess.params = {1.5 * truth.FocalX(), 0.5 * truth.width, 0.5 * truth.height, 0.0, 0.0};
  const Frames& frames = Rendered().walk;
  const slam::Result result = RunOn(guess, frames, {}, FocalPrior{guess.FocalX(), 0.5});
  ExpectHonest(result, frames);
  EXPECT_EQ(CountLocalized(result), static_cast<int>(frames.size()));
  ASSERT_TRUE(result.report.focal.has_value());
  EXPECT_TRUE(result.report.focal->IsDetermined());
  const Camera& found = result.models.front().reconstruction.cameras.begin()->second;
  EXPECT_EQ(found.FocalX(), result.report.focal->refined);
  EXPECT_NEAR(found.FocalX(), truth.FocalX(), 0.03 * truth.FocalX());
}

}  // namespace
}  // namespace s3lam
