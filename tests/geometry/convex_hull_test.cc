#include "s3lam/geometry/convex_hull.h"

#include <gtest/gtest.h>

namespace s3lam {
namespace {

TEST(ConvexHull, DropsInnerAndCollinearPoints) {
  const auto hull = ConvexHull({{0, 0}, {1, 0}, {2, 0}, {2, 2}, {1, 1}, {0, 2}, {0, 1}, {0, 0}});
  ASSERT_EQ(hull.size(), 4U);
  EXPECT_EQ(hull[0], Eigen::Vector2d(0, 0));
  EXPECT_EQ(hull[1], Eigen::Vector2d(2, 0));
  EXPECT_EQ(hull[2], Eigen::Vector2d(2, 2));
  EXPECT_EQ(hull[3], Eigen::Vector2d(0, 2));
  EXPECT_EQ(ConvexHull({{0, 0}, {1, 1}, {2, 2}}).size(), 2U);
  EXPECT_EQ(ConvexHull({{1, 1}}).size(), 1U);
}

}  // namespace
}  // namespace s3lam
