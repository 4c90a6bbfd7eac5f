#include "s3lam/synthetic/camera_path.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

#include "s3lam/base/error.h"
#include "s3lam/synthetic/scene.h"

namespace s3lam {
namespace {

std::vector<Eigen::Vector3d> Line(const Eigen::Vector3d& from, const Eigen::Vector3d& step) {
  std::vector<Eigen::Vector3d> knots;
  for (int i = 0; i < 6; ++i) knots.push_back(from + i * step);
  return knots;
}

TEST(CameraPath, LooksAtItsTargetUpright) {
  const CameraPath path(Line({0, -2, 1.5}, {0.1, 0, 0}), Line({0, 0, 1.0}, {0.1, 0, 0}), 4.0, {},
                        1);
  for (const double t : {0.0, 1.3, 4.0}) {
    const Rigid3 pose = path.WorldFromCamera(t);
    const Eigen::Vector3d forward = pose.rotation * Eigen::Vector3d::UnitZ();
    EXPECT_LT((forward - Eigen::Vector3d(0, 2, -0.5).normalized()).norm(), 1e-9);
    EXPECT_NEAR((pose.rotation * Eigen::Vector3d::UnitX()).z(), 0.0, 1e-12);  // Horizon level.
    EXPECT_LT((pose.rotation * Eigen::Vector3d::UnitY()).z(), 0.0);           // y points down.
  }
}

TEST(CameraPath, KeepsItsShapeWhenItsDurationChanges) {
  CameraPath path(Line({0, -2, 1.5}, {0.3, 0.1, 0}), Line({0, 0, 1.0}, {0.1, 0, 0}), 4.0, {}, 1);
  const Rigid3 before = path.WorldFromCamera(1.0);
  path.SetDuration(8.0);
  EXPECT_LT((path.WorldFromCamera(2.0).translation - before.translation).norm(), 1e-12);
  EXPECT_THROW(path.SetDuration(0.0), std::logic_error);
  EXPECT_THROW(CameraPath({{0, 0, 0}}, {{1, 0, 0}}, 1.0, {}, 1), std::logic_error);
}

TEST(CameraPath, ScenesMoveSmoothlyAtNaturalSpeed) {
  for (const std::string& name : SceneNames()) {
    const Scene scene = MakeScene(name, 2);
    const bool is_drive = scene.layout == SequenceLayout::kKittiStep;
    double longest = 0.0;
    double jerk = 0.0;
    for (int i = 1; i + 1 < scene.num_frames; ++i) {
      const Rigid3 a = scene.WorldFromCamera(i - 1);
      const Rigid3 b = scene.WorldFromCamera(i);
      const Rigid3 c = scene.WorldFromCamera(i + 1);
      longest = std::max(longest, (c.translation - b.translation).norm());
      jerk = std::max(jerk, (c.translation - 2.0 * b.translation + a.translation).norm());
      EXPECT_LT(RotationAngle(b.rotation, c.rotation), is_drive ? 0.09 : 0.035) << name << i;
    }
    EXPECT_LT(longest * scene.fps, is_drive ? 9.0 : 1.2) << name;
    EXPECT_LT(jerk, 0.5 * longest) << name;
  }
}

TEST(Scene, RejectsUnknownNamesAndNamesTheNearest) {
  try {
    MakeScene("dsk", 0);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_NE(std::string(error.what()).find("'desk'"), std::string::npos) << error.what();
  }
}

TEST(Scene, FramesFollowOptions) {
  SceneOptions options;
  options.num_frames = 17;
  EXPECT_EQ(MakeScene("desk", 0, options).num_frames, 17);
  SceneOptions fast;
  fast.speed = 2.0;
  EXPECT_NEAR(2.0 * MakeScene("desk", 0, fast).num_frames, MakeScene("desk", 0).num_frames, 2.0);
}

}  // namespace
}  // namespace s3lam
