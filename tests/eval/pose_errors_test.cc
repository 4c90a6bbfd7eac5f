#include "s3lam/eval/pose_errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace s3lam {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

/// A straight way along x with one pose per unit; the camera looks along the way (z forward).
std::vector<PosePair> Straight(int size, double scale) {
  Eigen::Matrix3d world_from_camera;
  world_from_camera << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const Eigen::Quaterniond rotation(world_from_camera);
  std::vector<PosePair> pairs;
  for (int i = 0; i < size; ++i) {
    pairs.push_back({0.1 * i,
                     {rotation, Eigen::Vector3d(i, 0, 0)},
                     {rotation, Eigen::Vector3d(scale * i, 0, 0)}});
  }
  return pairs;
}

TEST(PoseErrors, AreTakenApartAlongAndAcrossTheWay) {
  std::vector<PosePair> pairs = Straight(5, 1.0);
  pairs[2].estimate.translation += Eigen::Vector3d(0.5, 0.3, -0.4);
  const std::vector<PoseError> errors = ComputePoseErrors(pairs);
  ASSERT_EQ(errors.size(), 5u);
  EXPECT_DOUBLE_EQ(errors[2].path, 2.0);
  EXPECT_DOUBLE_EQ(errors[2].along, 0.5);
  EXPECT_NEAR(errors[2].across, 0.5, 1e-15);
  // x of the world is the camera's z, y its -x, z its -y.
  EXPECT_LT((errors[2].in_camera - Eigen::Vector3d(-0.3, 0.4, 0.5)).norm(), 1e-12);
  EXPECT_EQ(errors[3].difference.norm(), 0.0);
}

TEST(RelativeErrors, PerLengthShowAWrongScale) {
  const std::vector<PosePair> pairs = Straight(20, 1.02);
  const RelativeErrors errors = RelativeErrorsPerLength(pairs, 2.5);
  EXPECT_EQ(errors.translation.count, 17u);  // Three steps to each end.
  EXPECT_NEAR(errors.translation.min, 0.02, 1e-12);
  EXPECT_NEAR(errors.translation.max, 0.02, 1e-12);
  EXPECT_NEAR(errors.rotation_deg.max, 0.0, 1e-12);
  EXPECT_NEAR(RelativeErrorsOverFrames(pairs, 3).translation.mean, 0.06, 1e-12);
  EXPECT_EQ(RelativeErrorsPerLength(pairs, 100.0).translation.count, 0u);
}

TEST(SegmentErrors, AreKittis) {
  const std::vector<PosePair> pairs = Straight(31, 1.01);
  const std::vector<double> lengths = {9.5, 20.0, 100.0};
  const SegmentErrorTable table = ComputeSegmentErrors(pairs, lengths, 10);
  ASSERT_EQ(table.by_length.size(), 2u);  // 100 does not fit.
  EXPECT_EQ(table.by_length[0].count, 3u);
  EXPECT_NEAR(table.by_length[0].translation_percent, 100.0 * 0.1 / 9.5, 1e-9);
  // The end is the first pose MORE than 20 ahead, which is 21 ahead.
  EXPECT_EQ(table.by_length[1].count, 1u);
  EXPECT_NEAR(table.by_length[1].translation_percent, 100.0 * 0.21 / 20.0, 1e-9);
  EXPECT_EQ(table.all.count, 4u);
  EXPECT_NEAR(table.all.translation_percent,
              (3 * table.by_length[0].translation_percent + 1.05) / 4.0, 1e-9);
  EXPECT_THAT(ToTable(table), HasSubstr("1.0500"));
  EXPECT_EQ(ToJson(table)["by_length"][1]["length"], 20.0);
}

TEST(PoseErrors, ToCsvAndJson) {
  const std::vector<PosePair> pairs = Straight(3, 1.5);
  const std::vector<PoseError> errors = ComputePoseErrors(pairs);
  EXPECT_THAT(ToCsv(errors), StartsWith("time_s,path,error,"));
  EXPECT_THAT(ToCsv(errors), HasSubstr("\n0.2,2,1,1,0,0,"));
  const std::vector<std::string> names = {"a.png", "b, c.png", "d.png"};
  EXPECT_THAT(ToCsv(errors, names), HasSubstr("\n\"b, c.png\",0.1,1,0.5,"));
  EXPECT_THAT(ToCsv(errors, std::vector<std::string>{"a.png", "b \"c\".png", "d.png"}),
              HasSubstr("\n\"b \"\"c\"\".png\",0.1,1,0.5,"));
  const nlohmann::json json = ToJson(errors, names);
  EXPECT_EQ(json[1]["name"], "b, c.png");
  EXPECT_EQ(json[2]["along"], 1.0);
}

}  // namespace
}  // namespace s3lam
