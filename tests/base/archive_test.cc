#include "s3lam/base/archive.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>

namespace s3lam {
namespace {

struct Inner {
  Eigen::Vector2f pixel;
  std::vector<Eigen::Vector3d> points;
  template <typename A>
  void Transfer(A& archive) {
    archive(pixel, points);
  }
};

struct Outer {
  int count = 0;
  bool flag = false;
  std::string text;
  std::vector<uint8_t> bytes;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  std::vector<Inner> inner;
  std::vector<std::vector<int>> nested;
  template <typename A>
  void Transfer(A& archive) {
    archive(count, flag, text, bytes, rotation, inner, nested);
  }
};

std::string SomeBytes() {
  Outer value{-3, true, "a\0b", {0, 255}, {0.5, -0.5, 0.5, -0.5}, {}, {{1, 2}, {}, {3}}};
  value.inner = {{{1.5F, -2.0F}, {{1, 2, 3}, {4, 5, 6}}}, {}};
  value.inner[1].pixel = {0, 1};
  ArchiveWriter writer;
  writer(value);
  return writer.bytes();
}

TEST(Archive, ValuesComeBack) {
  const std::string bytes = SomeBytes();
  ArchiveReader reader(bytes);
  Outer value;
  reader(value);
  EXPECT_TRUE(reader.AtEnd());
  EXPECT_EQ(value.count, -3);
  EXPECT_EQ(value.rotation.coeffs(), Eigen::Vector4d(-0.5, 0.5, -0.5, 0.5));
  EXPECT_EQ(value.inner[0].points[1], Eigen::Vector3d(4, 5, 6));
  EXPECT_THAT(value.nested,
              ::testing::ElementsAre(::testing::ElementsAre(1, 2), ::testing::IsEmpty(),
                                     ::testing::ElementsAre(3)));
  ArchiveWriter again;
  again(value);
  EXPECT_EQ(again.bytes(), bytes);
}

TEST(Archive, EveryTruncationIsAnError) {
  const std::string bytes = SomeBytes();
  for (size_t size = 0; size < bytes.size(); ++size) {
    ArchiveReader reader(std::string_view(bytes).substr(0, size));
    Outer value;
    EXPECT_THROW(reader(value), std::runtime_error) << size;
  }
}

}  // namespace
}  // namespace s3lam
