#include "s3lam/io/constraints.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <numbers>
#include <sstream>

#include "s3lam/base/error.h"
#include "support/temp_dir.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

Reconstruction Model() { return testing::MakeTestScene({.num_images = 4, .num_points = 30}); }

Constraints ReadConstant(const std::string& text, const Reconstruction& model) {
  const testing::TempDir dir;
  std::ofstream(dir / "constant.json") << text;
  Constraints constraints;
  ReadConstantParts(dir / "constant.json", model, constraints);
  return constraints;
}

TEST(ConstantParts, AreFoundByNameAndId) {
  const Reconstruction model = Model();
  const Image& image = model.images.rbegin()->second;
  const PointId point = model.points.begin()->first;
  const Constraints constraints = ReadConstant(
      fmt::format(R"({{"images": ["{}"], "points": [{}]}})", image.name, point.value()), model);
  EXPECT_EQ(constraints.constant_images, std::set<ImageId>{image.id});
  EXPECT_EQ(constraints.constant_points, std::set<PointId>{point});
  const Constraints all = ReadConstant(R"({"images": "all", "points": "all"})", model);
  EXPECT_EQ(all.constant_images.size(), model.images.size());
  EXPECT_EQ(all.constant_points.size(), model.points.size());
  EXPECT_TRUE(ReadConstant("{}", model).constant_images.empty());
}

TEST(ConstantParts, DistancesOfPlanes) {
  const Constraints constraints = ReadConstant(
      R"({"plane_distances": [{"planes": [3, 7], "distance": 0.74, "sigma": 0.002}]})", Model());
  ASSERT_EQ(constraints.plane_distances.size(), 1u);
  const PlaneDistance& known = constraints.plane_distances.front();
  EXPECT_EQ(known.a, PlaneId(3));
  EXPECT_EQ(known.b, PlaneId(7));
  EXPECT_EQ(known.distance, 0.74);
  EXPECT_EQ(known.sigma, 0.002);
  for (const char* pair : {R"({"planes": [3], "distance": 1, "sigma": 1})",
                           R"({"planes": [3, 3], "distance": 1, "sigma": 1})",
                           R"({"planes": [3, 7], "distance": -1, "sigma": 1})",
                           R"({"planes": [3, 7], "distance": 1, "sigma": 0})",
                           R"({"planes": [3, -7], "distance": 1, "sigma": 1})",
                           R"({"planes": [3, 7], "distance": 1})"}) {
    EXPECT_THROW(ReadConstant(fmt::format(R"({{"plane_distances": [{}]}})", pair), Model()),
                 InputError)
        << pair;
  }
}

TEST(ConstantParts, WhatTheModelDoesNotHaveIsNamed) {
  const Reconstruction model = Model();
  const auto expect_error = [&](const std::string& text, const std::string& message) {
    EXPECT_THAT([&] { ReadConstant(text, model); }, ThrowsMessage<InputError>(HasSubstr(message)));
  };
  expect_error(R"({"images": ["nowhere.jpg"]})", "no image \"nowhere.jpg\"");
  expect_error(R"({"images": [3]})", "no image 3");
  expect_error(R"({"images": "some"})", "'images' is not a list");
  expect_error(R"({"points": [123456]})", "no point 123456");
  expect_error(R"({"points": [-1]})", "'points'");
  expect_error(R"({"cameras": []})", "unknown key 'cameras'");
  expect_error("[]", "expected an object");
}

std::vector<PosePrior> ReadPriors(const std::string& text, const Reconstruction& model,
                                  const std::vector<double>& times) {
  std::istringstream stream(text);
  Constraints constraints;
  ReadPosePriors(stream, "file", model, times, constraints);
  return constraints.pose_priors;
}

TEST(PosePriors, AreFoundByNameAndByTime) {
  const Reconstruction model = Model();
  const Image& last = model.images.rbegin()->second;
  const auto priors =
      ReadPriors("# comment\n" + last.name + " 1 2 3 0 0 0 1 0.5 0\n10.0004 4 5 6 0 0 0 1 0 90\n",
                 model, {10.0, 11.0, 12.0, 13.0});
  ASSERT_EQ(priors.size(), 2u);
  EXPECT_EQ(priors[0].image_id, model.images.begin()->first);
  EXPECT_EQ(priors[0].sigma_position, 0.0);
  EXPECT_NEAR(priors[0].sigma_rotation, std::numbers::pi / 2.0, 1e-12);
  EXPECT_EQ(priors[1].image_id, last.id);
  EXPECT_EQ(priors[1].cam_from_world.CenterInB(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(priors[1].sigma_position, 0.5);
}

TEST(PosePriors, NamesMayHaveSpaces) {
  Reconstruction model = Model();
  Image& image = model.images.rbegin()->second;
  image.name = "my photos/IMG 1  2.jpg";
  for (const char* end : {"\n", " \r\n", ""}) {
    const auto priors = ReadPriors(" " + image.name + "  1 2\t3 0 0 0 1 0.5 0" + end, model, {});
    ASSERT_EQ(priors.size(), 1u);
    EXPECT_EQ(priors[0].image_id, image.id);
    EXPECT_EQ(priors[0].cam_from_world.CenterInB(), Eigen::Vector3d(1, 2, 3));
    EXPECT_EQ(priors[0].sigma_position, 0.5);
  }
}

TEST(PosePriors, BadLinesAreNamed) {
  const Reconstruction model = Model();
  const auto expect_error = [&](const std::string& text, const std::string& message,
                                const std::vector<double>& times) {
    EXPECT_THAT([&] { ReadPriors(text, model, times); },
                ThrowsMessage<InputError>(HasSubstr(message)));
  };
  const std::vector<double> times{1, 2, 3, 4};
  expect_error("", "no pose priors", times);
  expect_error("nowhere.jpg 0 0 0 0 0 0 1 1 1", "file: line 1: 'nowhere.jpg' is neither", times);
  expect_error("my photo.jpg 0 0 0 0 0 0 1 1 1", "line 1: 'my photo.jpg' is neither", times);
  expect_error("1 0 0 0 0 0 0 1 1 1", "no keyframes.txt", {});
  expect_error("7.5 0 0 0 0 0 0 1 1 1", "no image of the model was taken at 7.5 s", times);
  expect_error("1 0 0 0 0 0 0 1 1", "sigma_rotation is missing", times);
  expect_error("1 0 0 0 0 0 0 2 1 1", "norm", times);
  expect_error("1 0 0 0 0 0 0 1 -1 1", "negative", times);
  expect_error("1 0 0 0 0 0 0 1 0 0", "both sigmas are 0", times);
  expect_error("1 0 nan 0 0 0 0 1 1 1", "translation", times);
  expect_error("1 0 0 0 0 0 0 1 1 1\n1 0 0 0 0 0 0 1 1 1", "line 2: a second prior", times);
}

}  // namespace
}  // namespace s3lam
