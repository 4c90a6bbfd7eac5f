#include "s3lam/io/trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <new>
#include <sstream>
#include <streambuf>

#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using testing::FileBytes;
using ::testing::HasSubstr;
using testing::TempDir;
using ::testing::ThrowsMessage;

Trajectory RandomTrajectory(size_t size) {
  Rng rng(3);
  Trajectory trajectory;
  for (size_t i = 0; i < size; ++i) {
    TimedPose& pose = trajectory.emplace_back();
    pose.time_s = 1403638538.5 + 0.05 * static_cast<double>(i) + rng.Uniform(0.0, 0.01);
    for (double& coordinate : pose.world_from_camera.translation) coordinate = rng.Gaussian();
    const double x = rng.Gaussian();
    const double y = rng.Gaussian();
    pose.world_from_camera.rotation = QuaternionFromRotationVector({x, y, rng.Gaussian()});
  }
  return trajectory;
}

void ExpectEqual(const Trajectory& a, const Trajectory& b) {
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].time_s, b[i].time_s);
    EXPECT_EQ(a[i].world_from_camera.translation, b[i].world_from_camera.translation);
    EXPECT_EQ(a[i].world_from_camera.rotation.coeffs(), b[i].world_from_camera.rotation.coeffs());
  }
}

/// A source of characters that ends in an exception.
template <typename Exception>
class FailingBuffer : public std::streambuf {
 protected:
  int_type underflow() override { throw Exception(); }
};

struct DiskFailure : std::ios::failure {
  DiskFailure() : std::ios::failure("error reading the file") {}
};

TEST(Trajectory, TellsTheEndOfMemoryFromThatOfTheDisk) {
  FailingBuffer<std::bad_alloc> without_memory;
  std::istream large(&without_memory);
  EXPECT_THROW((void)ReadTumTrajectory(large, "poses.txt"), std::bad_alloc);
  FailingBuffer<DiskFailure> broken;
  std::istream unreadable(&broken);
  EXPECT_THAT([&] { (void)ReadTumTrajectory(unreadable, "poses.txt"); },
              ThrowsMessage<InputError>(HasSubstr("poses.txt: cannot read")));
}

TEST(Trajectory, TumRoundTripIsExact) {
  const Trajectory trajectory = RandomTrajectory(20);
  std::stringstream stream;
  WriteTumTrajectory(trajectory, stream);
  ExpectEqual(trajectory, ReadTumTrajectory(stream, "stream"));
  const TempDir dir;
  WriteTumTrajectory(trajectory, dir / "poses.txt");
  ExpectEqual(trajectory, ReadTumTrajectory(dir / "poses.txt"));
  ExpectEqual(trajectory, ReadTrajectory(dir / "poses.txt"));
}

TEST(Trajectory, TumLinesHaveSingleSpacesAndNoneAtTheEnd) {
  std::ostringstream stream;
  WriteTumTrajectory({{0.25, {Eigen::Quaterniond::Identity(), {1.0, -2.5, 3.0}}}}, stream);
  EXPECT_THAT(stream.str(), ::testing::EndsWith("\n0.25 1 -2.5 3 0 0 0 1\n"));
  EXPECT_THAT(stream.str(), ::testing::StartsWith("#"));
}

TEST(Trajectory, KittiPosesAreReadWithTheirTimes) {
  const std::string text = "1 0 0 1 0 1 0 2 0 0 1 3\n0 -1 0 4 1 0 0 5 0 0 1 6\n";
  std::istringstream stream(text);
  const Trajectory trajectory = ReadKittiTrajectory(stream, "poses", {0.5, 0.75});
  ASSERT_EQ(trajectory.size(), 2u);
  EXPECT_EQ(trajectory[1].time_s, 0.75);
  EXPECT_EQ(trajectory[1].world_from_camera.translation, Eigen::Vector3d(4, 5, 6));
  const Eigen::Vector3d turned =
      trajectory[1].world_from_camera.rotation * Eigen::Vector3d::UnitX();
  EXPECT_NEAR((turned - Eigen::Vector3d::UnitY()).norm(), 0.0, 1e-15);

  const TempDir dir;
  const Trajectory by_number = ReadTrajectory(dir.Write("07.txt", text));
  EXPECT_EQ(by_number[0].time_s, 0.0);
  EXPECT_EQ(by_number[1].time_s, 1.0);
}

TEST(Trajectory, TimesOfKittiComeFromTheFileBeside) {
  const TempDir dir;
  const std::string pose = "1 0 0 0 0 1 0 0 0 0 1 0\n";
  const auto kitti = dir.Write("kitti/07.txt", pose + pose);
  const auto tum = dir.Write("tum/frames.txt", "0 0 0 0 0 0 0 1\n0.1 0 0 0 0 0 0 1\n");
  EXPECT_TRUE(IsTrajectoryWithoutTimes(kitti));
  EXPECT_THAT([&] { CheckBothHaveTimes(tum, kitti); },
              ThrowsMessage<InputError>(AllOf(HasSubstr("07.txt"), HasSubstr("times.txt"))));
  EXPECT_NO_THROW(CheckBothHaveTimes(kitti, kitti));
  dir.Write("kitti/times.txt", "0.0\n1.037e-01\n");
  EXPECT_EQ(ReadTrajectory(kitti)[1].time_s, 0.1037);
  EXPECT_NO_THROW(CheckBothHaveTimes(tum, kitti));
  dir.Write("kitti/times.txt", "0.0\n");
  EXPECT_THROW(ReadTrajectory(kitti), InputError);
}

TEST(Trajectory, FaultsAreNamedWithTheirLine) {
  const auto expect_error = [](const std::string& text, const std::string& message) {
    std::istringstream stream(text);
    EXPECT_THAT([&] { ReadTumTrajectory(stream, "poses.txt"); },
                ThrowsMessage<InputError>(AllOf(HasSubstr("poses.txt"), HasSubstr(message))))
        << text;
  };
  expect_error("", "no poses");
  expect_error("# only a comment\n", "no poses");
  expect_error("0 0 0 0 0 0 0\n", "line 1: quaternion is missing");
  expect_error("0 0 0 0 0 0 0 1 9\n", "line 1: unexpected text");
  expect_error("0 0 0 nan 0 0 0 1\n", "not finite");
  expect_error("0 0 0 x 0 0 0 1\n", "not a number");
  expect_error("0 0 0 0 0 0 0 0\n", "norm");
  expect_error("#\n1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "line 3: time 1 is not after");
  std::istringstream kitti("2 0 0 0 0 1 0 0 0 0 1 0\n");
  EXPECT_THAT([&] { ReadKittiTrajectory(kitti, "07.txt"); },
              ThrowsMessage<InputError>(HasSubstr("not a rotation")));
  std::istringstream short_kitti("1 0 0 0 0 1 0 0 0 0 1 0\n");
  EXPECT_THAT(
      [&] {
        ReadKittiTrajectory(short_kitti, "07.txt", {0.0, 1.0});
      },
      ThrowsMessage<InputError>(HasSubstr("1 poses for 2 times")));
  const TempDir dir;
  EXPECT_THAT([&] { ReadTrajectory(dir.Write("odd.txt", "1 2 3\n")); },
              ThrowsMessage<InputError>(HasSubstr("3 columns")));
  EXPECT_THROW(ReadTrajectory(dir / "absent.txt"), InputError);
  EXPECT_THROW(ReadTrajectory(dir.path()), InputError);
}

}  // namespace
}  // namespace s3lam
