#include <gtest/gtest.h>

#include <numbers>

#include "s3lam/base/rng.h"
#include "s3lam/geometry/alignment.h"
#include "s3lam/geometry/plane.h"
#include "s3lam/geometry/rigid3.h"
#include "s3lam/geometry/similarity3.h"

namespace s3lam {
namespace {

constexpr double kTolerance = 1e-12;

Eigen::Vector3d RandomVector(Rng& rng, double sigma = 1.0) {
  const double x = rng.Gaussian(0.0, sigma);
  const double y = rng.Gaussian(0.0, sigma);
  return {x, y, rng.Gaussian(0.0, sigma)};
}

Rigid3 RandomRigid(Rng& rng) {
  const Eigen::Quaterniond rotation = QuaternionFromRotationVector(RandomVector(rng));
  return {rotation, RandomVector(rng)};
}

Similarity3 RandomSimilarity(Rng& rng) {
  const Rigid3 rigid = RandomRigid(rng);
  return {rng.Uniform(0.2, 5.0), rigid.rotation, rigid.translation};
}

double Distance(const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return (a - b).norm(); }

TEST(Rigid3, CompositionInverseAndCenter) {
  Rng rng(1);
  for (int i = 0; i < 50; ++i) {
    const Rigid3 a_from_b = RandomRigid(rng);
    const Rigid3 b_from_c = RandomRigid(rng);
    const Eigen::Vector3d x = RandomVector(rng);
    EXPECT_LT(Distance((a_from_b * b_from_c) * x, a_from_b * (b_from_c * x)), kTolerance);
    EXPECT_LT(Distance(a_from_b.Inverse() * (a_from_b * x), x), kTolerance);
    EXPECT_LT((a_from_b * a_from_b.CenterInB()).norm(), kTolerance);
    EXPECT_LT(Distance(a_from_b.CenterInB(), a_from_b.Inverse().translation), kTolerance);
  }
}

TEST(RotationVector, RoundTripAndSmallAngles) {
  Rng rng(2);
  for (const double angle : {0.0, 1e-12, 1e-8, 1e-7, 1e-4, 0.5, 3.1, std::numbers::pi - 1e-9}) {
    const Eigen::Vector3d omega = angle * RandomVector(rng).normalized();
    const Eigen::Quaterniond q = QuaternionFromRotationVector(omega);
    EXPECT_NEAR(q.norm(), 1.0, 1e-15);
    EXPECT_LT(Distance(RotationVectorFromQuaternion(q), omega), 1e-14 + 1e-9 * angle) << angle;
    const Eigen::Quaterniond minus_q(-q.coeffs());
    EXPECT_LT(Distance(RotationVectorFromQuaternion(minus_q), omega), 1e-14 + 1e-9 * angle);
    const Eigen::AngleAxisd expected(angle,
                                     angle > 0 ? omega.normalized() : Eigen::Vector3d::UnitX());
    EXPECT_LT((q.toRotationMatrix() - expected.toRotationMatrix()).norm(), 1e-14);
    EXPECT_NEAR(RotationAngle(Eigen::Quaterniond::Identity(), q), angle, 1e-14 + 1e-9 * angle);
  }
}

TEST(CrossMatrix, IsTheCrossProduct) {
  Rng rng(3);
  const Eigen::Vector3d v = RandomVector(rng);
  const Eigen::Vector3d w = RandomVector(rng);
  EXPECT_LT(Distance(CrossMatrix(v) * w, v.cross(w)), kTolerance);
}

TEST(Similarity3, CompositionAndInverse) {
  Rng rng(4);
  for (int i = 0; i < 50; ++i) {
    const Similarity3 a_from_b = RandomSimilarity(rng);
    const Similarity3 b_from_c = RandomSimilarity(rng);
    const Eigen::Vector3d x = RandomVector(rng);
    EXPECT_LT(Distance((a_from_b * b_from_c) * x, a_from_b * (b_from_c * x)), 1e-11);
    EXPECT_LT(Distance(a_from_b.Inverse() * (a_from_b * x), x), 1e-11);
  }
}

TEST(Similarity3, CameraSeesTheSameRayInTheNewWorld) {
  Rng rng(5);
  for (int i = 0; i < 50; ++i) {
    const Similarity3 a_from_b = RandomSimilarity(rng);
    const Rigid3 cam_from_b = RandomRigid(rng);
    const Eigen::Vector3d x = RandomVector(rng);
    const Rigid3 cam_from_a = TransformCameraPose(a_from_b, cam_from_b);
    // The camera frame takes the scale of the world.
    EXPECT_LT(Distance(cam_from_a * (a_from_b * x), a_from_b.scale * (cam_from_b * x)), 1e-11);
  }
}

TEST(Plane, DistanceProjectionAndTransform) {
  Rng rng(6);
  for (int i = 0; i < 50; ++i) {
    const Plane plane{RandomVector(rng).normalized(), rng.Gaussian()};
    const Eigen::Vector3d x = RandomVector(rng);
    EXPECT_NEAR(plane.SignedDistance(plane.Project(x)), 0.0, kTolerance);
    EXPECT_NEAR(Distance(plane.Project(x), x), std::abs(plane.SignedDistance(x)), kTolerance);
    const Similarity3 a_from_b = RandomSimilarity(rng);
    const Plane moved = TransformPlane(a_from_b, plane);
    EXPECT_NEAR(moved.normal.norm(), 1.0, kTolerance);
    EXPECT_NEAR(moved.SignedDistance(a_from_b * x), a_from_b.scale * plane.SignedDistance(x),
                1e-11);
  }
}

TEST(Plane, AngleIgnoresTheSignOfTheNormal) {
  const Plane floor{Eigen::Vector3d::UnitZ(), 0.0};
  for (const double angle : {0.0, 1e-9, 0.3, 1.5, std::numbers::pi / 2}) {
    const Plane tilted{{std::sin(angle), 0.0, std::cos(angle)}, 1.0};
    EXPECT_NEAR(PlaneAngle(floor, tilted), angle, 1e-15);
    EXPECT_NEAR(PlaneAngle(floor, {-tilted.normal, 1.0}), angle, 1e-15);
  }
}

TEST(Plane, AxesMakeARightHandedFrame) {
  Rng rng(7);
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector3d normal = RandomVector(rng).normalized();
    const auto [u, v] = PlaneAxes(normal);
    EXPECT_LT(Distance(u.cross(v), normal), kTolerance);
    EXPECT_NEAR(u.dot(v), 0.0, kTolerance);
  }
}

class Alignment : public ::testing::Test {
 protected:
  std::vector<Eigen::Vector3d> points_in_a;
  std::vector<Eigen::Vector3d> points_in_b;

  void Fill(const Similarity3& a_from_b, size_t count, double noise, Rng& rng) {
    points_in_a.clear();
    points_in_b.clear();
    for (size_t i = 0; i < count; ++i) {
      points_in_b.push_back(RandomVector(rng));
      points_in_a.push_back(a_from_b * points_in_b.back() + RandomVector(rng, noise));
    }
  }
  [[nodiscard]] double Cost(const Similarity3& a_from_b) const {
    double sum = 0.0;
    for (size_t i = 0; i < points_in_a.size(); ++i) {
      sum += (points_in_a[i] - a_from_b * points_in_b[i]).squaredNorm();
    }
    return sum;
  }
};

TEST_F(Alignment, RecoversASimilarity) {
  Rng rng(8);
  for (int i = 0; i < 20; ++i) {
    const Similarity3 truth = RandomSimilarity(rng);
    Fill(truth, 3 + static_cast<size_t>(i), 0.0, rng);
    const auto found = AlignPoints(points_in_a, points_in_b);
    ASSERT_TRUE(found.has_value());
    EXPECT_NEAR(found->scale, truth.scale, 1e-9);
    EXPECT_LT(RotationAngle(found->rotation, truth.rotation), 1e-9);
    EXPECT_LT(Distance(found->translation, truth.translation), 1e-9);
  }
}

TEST_F(Alignment, RecoversARigidTransformWithoutScale) {
  Rng rng(9);
  const Rigid3 truth = RandomRigid(rng);
  Fill({1.0, truth.rotation, truth.translation}, 20, 0.0, rng);
  const auto found = AlignPoints(points_in_a, points_in_b, /*with_scale=*/false);
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->scale, 1.0);
  EXPECT_LT(RotationAngle(found->rotation, truth.rotation), 1e-9);
}

TEST_F(Alignment, IsTheLeastSquaresOptimum) {
  Rng rng(10);
  for (const bool with_scale : {true, false}) {
    Fill(RandomSimilarity(rng), 30, 0.3, rng);
    const auto found = AlignPoints(points_in_a, points_in_b, with_scale);
    ASSERT_TRUE(found.has_value());
    const double cost = Cost(*found);
    for (int i = 0; i < 100; ++i) {
      Similarity3 other = *found;
      other.rotation = other.rotation * QuaternionFromRotationVector(RandomVector(rng, 1e-3));
      other.translation += RandomVector(rng, 1e-3);
      if (with_scale) other.scale *= 1.0 + rng.Gaussian(0.0, 1e-3);
      EXPECT_GE(Cost(other), cost);
    }
  }
}

TEST_F(Alignment, NeverMirrors) {
  // Points on a plane, and a mirrored set: the best proper rotation is asked for.
  points_in_b = {{1, 0, 0}, {0, 2, 0}, {-1, 0, 0}, {0, -1, 0}};
  points_in_a = points_in_b;
  for (Eigen::Vector3d& x : points_in_a) x.x() = -x.x();
  const auto found = AlignPoints(points_in_a, points_in_b);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->rotation.toRotationMatrix().determinant(), 1.0, 1e-12);
  EXPECT_LT(Cost(*found), 1e-20);  // A half turn about y does it.
}

TEST_F(Alignment, DegenerateSetsAreRefused) {
  Rng rng(11);
  Fill(RandomSimilarity(rng), 2, 0.0, rng);
  EXPECT_FALSE(AlignPoints(points_in_a, points_in_b).has_value());
  points_in_a.assign(5, Eigen::Vector3d(1, 2, 3));
  points_in_b.assign(5, Eigen::Vector3d(3, 2, 1));
  EXPECT_FALSE(AlignPoints(points_in_a, points_in_b).has_value());
  for (size_t i = 0; i < 5; ++i) {
    points_in_a[i] = static_cast<double>(i) * Eigen::Vector3d(1, 0, 0);
    points_in_b[i] = static_cast<double>(i) * Eigen::Vector3d(0, 1, 0);
  }
  EXPECT_FALSE(AlignPoints(points_in_a, points_in_b).has_value());
}

}  // namespace
}  // namespace s3lam
