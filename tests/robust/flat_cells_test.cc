#include "s3lam/robust/flat_cells.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "s3lam/base/rng.h"

namespace s3lam {
namespace {

constexpr double kSigma = 0.05;

/// Points of the plane z = 0 over [from, from + 4] x [0, 2], moved by `step` along z.
std::vector<UncertainPoint> Wall(double from, double step, int count, uint64_t seed) {
  Rng rng(seed);
  std::vector<UncertainPoint> points;
  for (int i = 0; i < count; ++i) {
    points.push_back(
        {{rng.Uniform(from, from + 4.0), rng.Uniform(0.0, 2.0), step + kSigma * rng.Gaussian()},
         kSigma * kSigma * Eigen::Matrix3d::Identity()});
  }
  return points;
}

int CountFlat(const std::vector<uint8_t>& flat, size_t begin, size_t end) {
  return std::accumulate(flat.begin() + static_cast<std::ptrdiff_t>(begin),
                         flat.begin() + static_cast<std::ptrdiff_t>(end), 0);
}

const Plane kPlane{Eigen::Vector3d::UnitZ(), 0.0};

TEST(FlatCells, KeepsWhatLiesOnThePlane) {
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    const auto points = Wall(0.0, 0.0, 400, seed);
    EXPECT_GE(CountFlat(FlatCells({}, points, kPlane), 0, 400), 360) << seed;
  }
}

TEST(FlatCells, DropsANeighbourWhosePointsAreEachWithinTheirUncertainty) {
  // Two sigmas of a point are six of the mean of ten.
  auto points = Wall(0.0, 0.0, 400, 1);
  const auto neighbour = Wall(4.0, 2.0 * kSigma, 200, 2);
  points.insert(points.end(), neighbour.begin(), neighbour.end());
  const std::vector<uint8_t> flat = FlatCells({}, points, kPlane);
  EXPECT_GE(CountFlat(flat, 0, 400), 340);
  EXPECT_LE(CountFlat(flat, 400, 600), 40);
}

TEST(FlatCells, ForgivesSomeStrayPoints) {
  auto points = Wall(0.0, 0.0, 400, 1);
  for (size_t i = 0; i < points.size(); i += 5) points[i].xyz.z() += 1.0;
  EXPECT_GE(CountFlat(FlatCells({}, points, kPlane), 0, 400), 340);
}

TEST(FlatCells, SaysNothingOfTooFewPoints) {
  const auto points = Wall(0.0, 1.0, 9, 1);
  EXPECT_EQ(CountFlat(FlatCells({}, points, kPlane), 0, 9), 9);
  EXPECT_TRUE(FlatCells({}, {}, kPlane).empty());
}

TEST(FlatCells, DoesNotDependOnTheOrderOfThePoints) {
  auto points = Wall(0.0, 0.0, 100, 1);
  const auto neighbour = Wall(4.0, 2.0 * kSigma, 50, 2);
  points.insert(points.end(), neighbour.begin(), neighbour.end());
  const std::vector<uint8_t> flat = FlatCells({}, points, kPlane);
  std::vector<UncertainPoint> reversed(points.rbegin(), points.rend());
  std::vector<uint8_t> back = FlatCells({}, reversed, kPlane);
  std::reverse(back.begin(), back.end());
  EXPECT_EQ(flat, back);
}

}  // namespace
}  // namespace s3lam
