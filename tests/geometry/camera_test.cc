#include "s3lam/geometry/camera.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <opencv2/calib3d.hpp>

#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using ::testing::HasSubstr;
using testing::MakeTestCamera;
using ::testing::ThrowsMessage;

std::vector<CameraModel> AllModels() {
  std::vector<CameraModel> models;
  for (int i = 0; i < kNumCameraModels; ++i) models.push_back(static_cast<CameraModel>(i));
  return models;
}

class EveryCameraModel : public ::testing::TestWithParam<CameraModel> {};
INSTANTIATE_TEST_SUITE_P(Models, EveryCameraModel, ::testing::ValuesIn(AllModels()),
                         [](const auto& model) {
                           return std::string(CameraModelName(model.param));
                         });

TEST_P(EveryCameraModel, NameAndIdAreColmaps) {
  const CameraModel model = GetParam();
  EXPECT_EQ(CameraModelFromName(CameraModelName(model)), model);
  EXPECT_EQ(CameraModelFromId(static_cast<int>(model)), model);
  EXPECT_EQ(static_cast<int>(MakeTestCamera(model).params.size()), CameraModelNumParams(model));
}

TEST_P(EveryCameraModel, UnprojectionInvertsProjection) {
  const Camera camera = MakeTestCamera(GetParam());
  for (double y = 0.0; y <= camera.height; y += 20.0) {
    for (double x = 0.0; x <= camera.width; x += 20.0) {
      const auto ray = camera.CameraFromImage({x, y});
      ASSERT_TRUE(ray.has_value()) << x << " " << y;
      const auto back = camera.ImageFromCamera(7.5 * ray->homogeneous());
      ASSERT_TRUE(back.has_value());
      EXPECT_LT((*back - Eigen::Vector2d(x, y)).norm(), 1e-7);
      // On the near branch: farther out in the image is farther from the axis.
      EXPECT_LT(ray->norm(), 1.5);
    }
  }
}

TEST_P(EveryCameraModel, PrincipalPointIsTheAxis) {
  const Camera camera = MakeTestCamera(GetParam());
  const auto xy = camera.ImageFromCamera({0.0, 0.0, 2.0});
  ASSERT_TRUE(xy.has_value());
  EXPECT_DOUBLE_EQ(xy->x(), camera.PrincipalX());
  EXPECT_DOUBLE_EQ(xy->y(), camera.PrincipalY());
  EXPECT_EQ(camera.PrincipalX(), 321.5);
  EXPECT_EQ(camera.PrincipalY(), 238.25);
  EXPECT_EQ(camera.FocalX(), 500.0);
  EXPECT_EQ(camera.FocalY(), CameraModelHasSingleFocal(GetParam()) ? 500.0 : 505.0);
}

TEST_P(EveryCameraModel, NothingBehindIsSeen) {
  const Camera camera = MakeTestCamera(GetParam());
  EXPECT_FALSE(camera.ImageFromCamera({0.1, 0.1, -1.0}).has_value());
  EXPECT_FALSE(camera.ImageFromCamera({0.1, 0.1, 0.0}).has_value());
}

/// Projects with OpenCV; `fisheye` chooses its equidistant model.
cv::Point2d ProjectWithOpenCv(const Camera& camera, const std::vector<double>& distortion,
                              bool fisheye, const Eigen::Vector3d& xyz) {
  const cv::Matx33d k(camera.FocalX(), 0, camera.PrincipalX(), 0, camera.FocalY(),
                      camera.PrincipalY(), 0, 0, 1);
  const std::vector<cv::Point3d> points = {{xyz.x(), xyz.y(), xyz.z()}};
  std::vector<cv::Point2d> projected;
  const cv::Vec3d zero(0, 0, 0);
  if (fisheye) {
    cv::fisheye::projectPoints(points, projected, zero, zero, k, distortion);
  } else {
    cv::projectPoints(points, zero, zero, k, distortion, projected);
  }
  return projected[0];
}

/// The model's distortion in OpenCV's order.
std::vector<double> OpenCvDistortion(const Camera& camera) {
  const std::vector<double>& p = camera.params;
  switch (camera.model) {
    case CameraModel::kSimpleRadial:
    case CameraModel::kSimpleRadialFisheye:
      return {p[3], 0, 0, 0};
    case CameraModel::kRadial:
    case CameraModel::kRadialFisheye:
      return {p[3], p[4], 0, 0};
    case CameraModel::kOpenCv:
    case CameraModel::kOpenCvFisheye:
    case CameraModel::kFullOpenCv:
      return {p.begin() + 4, p.end()};
    default:
      return std::vector<double>(4, 0.0);
  }
}

TEST(CameraModels, AgreeWithOpenCv) {
  for (const CameraModel model : AllModels()) {
    if (model == CameraModel::kFov) continue;  // OpenCV does not have it.
    const Camera camera = MakeTestCamera(model);
    const bool fisheye = CameraModelName(model).ends_with("FISHEYE");
    Rng rng(1);
    for (int i = 0; i < 200; ++i) {
      const double x = rng.Uniform(-1.2, 1.2);
      const double y = rng.Uniform(-1.0, 1.0);
      const Eigen::Vector3d xyz(x, y, rng.Uniform(1.0, 3.0));
      const cv::Point2d expected =
          ProjectWithOpenCv(camera, OpenCvDistortion(camera), fisheye, xyz);
      const auto xy = camera.ImageFromCamera(xyz);
      ASSERT_TRUE(xy.has_value());
      EXPECT_NEAR(xy->x(), expected.x, 1e-9) << CameraModelName(model);
      EXPECT_NEAR(xy->y(), expected.y, 1e-9) << CameraModelName(model);
    }
  }
}

TEST(FovCamera, FollowsItsFormulaAndItsLimits) {
  Camera camera = MakeTestCamera(CameraModel::kFov);
  const Eigen::Vector3d xyz(0.3, -0.4, 1.0);
  const double omega = camera.params[4];
  const double distorted = std::atan(2.0 * 0.5 * std::tan(omega / 2.0)) / omega;
  EXPECT_NEAR((camera.ImageFromCamera(xyz)->x() - 321.5) / 500.0, 0.6 * distorted, 1e-12);
  // The series near omega = 0 and near the axis meet the formula.
  for (const double small : {0.0, 0.9e-4, 1.1e-4}) {
    camera.params[4] = small;
    EXPECT_NEAR(camera.ImageFromCamera(xyz)->x(), 321.5 + 500.0 * 0.3, 1e-5);
  }
  camera.params[4] = omega;
  const double slope = 2.0 * std::tan(omega / 2.0) / omega;
  for (const double r : {1e-9, 0.9e-6 / omega, 1.1e-6 / omega}) {
    EXPECT_NEAR(camera.ImageFromCamera({r, 0.0, 1.0})->x(), 321.5 + 500.0 * slope * r, 1e-10);
  }
}

TEST(Camera, UnsupportedModelsAreNotKnown) {
  for (const int id : {-1, 10, 11, 12}) EXPECT_FALSE(CameraModelFromId(id).has_value()) << id;
  EXPECT_FALSE(CameraModelFromName("THIN_PRISM_FISHEYE").has_value());
  EXPECT_FALSE(CameraModelFromName("pinhole").has_value());
}

TEST(Camera, UnprojectionSaysWhenThereIsNoSolution) {
  // Strong barrel distortion folds back: the image of the model ends at some radius.
  Camera camera{CameraId(1), CameraModel::kSimpleRadial, 640, 480, {500.0, 320.0, 240.0, -0.5}};
  EXPECT_TRUE(camera.CameraFromImage({330.0, 240.0}).has_value());
  EXPECT_FALSE(camera.CameraFromImage({5000.0, 240.0}).has_value());
}

TEST(Camera, CheckNamesEachFault) {
  const auto expect_fault = [](const auto& change, const std::string& message) {
    Camera camera = MakeTestCamera(CameraModel::kPinhole);
    camera.Check("file");
    change(camera);
    EXPECT_THAT([&] { camera.Check("file"); }, ThrowsMessage<InputError>(HasSubstr(message)));
  };
  expect_fault([](Camera& c) { c.width = 0; }, "not positive");
  expect_fault([](Camera& c) { c.height = -1; }, "not positive");
  expect_fault([](Camera& c) { c.params.pop_back(); }, "4 parameters, got 3");
  expect_fault([](Camera& c) { c.params[0] = 0.0; }, "focal");
  expect_fault([](Camera& c) { c.params[1] = -500.0; }, "focal");
  expect_fault([](Camera& c) { c.params[2] = std::numeric_limits<double>::quiet_NaN(); }, "finite");
}

}  // namespace
}  // namespace s3lam
