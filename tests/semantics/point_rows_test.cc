#include "s3lam/semantics/point_rows.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace s3lam {
namespace {

Reconstruction WithPoints(std::initializer_list<uint64_t> ids) {
  Reconstruction scene;
  for (const uint64_t id : ids) scene.points[PointId(id)] = {};
  return scene;
}

TEST(PointRows, NumberByAscendingId) {
  for (const uint64_t last : {7ULL, 1'000'000'000'000ULL}) {  // By a table, and without.
    const PointRows rows(WithPoints({last, 2, 5}));
    ASSERT_EQ(rows.size(), 3U);
    EXPECT_EQ(rows.IdOf(0), PointId(2));
    EXPECT_EQ(rows.IdOf(2), PointId(last));
    EXPECT_EQ(rows.RowOf(PointId(2)), 0U);
    EXPECT_EQ(rows.RowOf(PointId(5)), 1U);
    EXPECT_EQ(rows.RowOf(PointId(last)), 2U);
  }
}

TEST(PointRows, KnowNoOtherPoint) {
  for (const uint64_t last : {7ULL, 1'000'000'000'000ULL}) {
    const PointRows rows(WithPoints({2, 5, last}));
    EXPECT_THROW((void)rows.RowOf(PointId(0)), std::exception);
    EXPECT_THROW((void)rows.RowOf(PointId(3)), std::exception);
    EXPECT_THROW((void)rows.RowOf(PointId(last + 1)), std::exception);
  }
  EXPECT_EQ(PointRows(Reconstruction{}).size(), 0U);
}

}  // namespace
}  // namespace s3lam
