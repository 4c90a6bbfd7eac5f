#include "s3lam/report/overlay.h"

#include <gtest/gtest.h>

#include "s3lam/report/map_view.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using Eigen::Vector3d;

constexpr Rgb kRed = {250, 10, 20};

/// A camera 4 above z = 0 that looks down at it, and points on it of one cluster and plane.
struct Flat {
  Reconstruction model;
  SemanticMap map;
  Image* image = nullptr;

  Flat() {
    model.cameras[CameraId(1)] = testing::MakeTestCamera(CameraModel::kPinhole);
    image = &model.images[ImageId(1)];
    image->id = ImageId(1);
    image->camera_id = CameraId(1);
    image->cam_from_world = testing::LookAt({0.01, 0.0, 4.0}, Vector3d::Zero());
    SemanticClass table;
    table.id = 1;
    table.color = kRed;
    map.class_table.classes = {table};
    Cluster& cluster = map.clusters[ClusterId(3)];
    cluster.id = ClusterId(3);
    PlanarSurface& plane = map.planes[PlaneId(2)];
    plane.id = PlaneId(2);
    plane.cluster_id = ClusterId(3);
    plane.plane_in_world = {Vector3d::UnitZ(), 0.0};
    plane.extent = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
    for (int i = 0; i < 9; ++i) AddPoint({0.5 * (i % 3 - 1), 0.5 * (i / 3 - 1), 0.0});
    plane.inliers = map.points;
    cluster.points = map.points;
  }

  void AddPoint(const Vector3d& xyz) {
    const PointId id(10 + map.points.size());
    model.points[id].xyz = xyz;
    image->points2D.push_back(
        {*model.cameras[CameraId(1)].ImageFromCamera(image->cam_from_world * xyz), id});
    map.points.push_back(id);
    map.cluster_of_point.push_back(ClusterId(3));
  }

  [[nodiscard]] cv::Mat Draw(const OverlayOptions& options = {}) const {
    cv::Mat picture(static_cast<int>(480 * options.scale), static_cast<int>(640 * options.scale),
                    CV_8UC3, cv::Scalar::all(255));
    const std::vector<PlanarSurface> planes = {map.planes.at(PlaneId(2))};
    DrawOverlay(model.cameras.at(CameraId(1)), *image, map, RowsOfPoints(map), planes, model,
                options, picture);
    return picture;
  }
};

cv::Vec3b At(const cv::Mat& picture, const Eigen::Vector2d& xy, double scale = 1.0) {
  return picture.at<cv::Vec3b>(static_cast<int>(xy.y() * scale), static_cast<int>(xy.x() * scale));
}

const cv::Vec3b kRedBgr(20, 10, 250);
const cv::Vec3b kWhite(255, 255, 255);

TEST(Overlay, KeypointsAreInTheColourOfTheirClass) {
  const Flat flat;
  for (const double scale : {1.0, 0.5}) {
    OverlayOptions options;
    options.scale = scale;
    const cv::Mat picture = flat.Draw(options);
    for (const Point2D& keypoint : flat.image->points2D) {
      EXPECT_EQ(At(picture, keypoint.xy, scale), kRedBgr);
    }
  }
}

TEST(Overlay, PointsOfNoClusterAreGrey) {
  Flat flat;
  flat.map.cluster_of_point[8] = kInvalidClusterId;
  EXPECT_EQ(At(flat.Draw(), flat.image->points2D[8].xy), cv::Vec3b(150, 150, 150));
}

TEST(Overlay, OutlineIsDrawnWhereThePlaneEnds) {
  const Flat flat;
  const auto edge = flat.model.cameras.at(CameraId(1))
                        .ImageFromCamera(flat.image->cam_from_world * Vector3d(1.0, 0.3, 0.0));
  ASSERT_TRUE(edge);
  EXPECT_NE(At(flat.Draw(), *edge), kWhite);
}

TEST(Overlay, PlanesTheImageHardlySeesAreNotDrawn) {
  const Flat flat;
  OverlayOptions options;
  options.min_plane_observations = 10;
  const auto edge = flat.model.cameras.at(CameraId(1))
                        .ImageFromCamera(flat.image->cam_from_world * Vector3d(1.0, 0.3, 0.0));
  EXPECT_EQ(At(flat.Draw(options), *edge), kWhite);
}

TEST(Overlay, PlaneBehindTheCameraIsNoError) {
  Flat flat;
  flat.map.planes.at(PlaneId(2)).axis_u_in_world = Vector3d::UnitZ();
  flat.map.planes.at(PlaneId(2)).extent = {{-100, -100}, {100, -100}, {100, 100}};
  EXPECT_EQ(flat.Draw().size(), cv::Size(640, 480));
}

// Barrel distortion bends rays far from the axis back: this edge would cross the picture.
TEST(Overlay, OutlineBeyondTheFoldOfTheDistortionIsNotDrawn) {
  Flat flat;
  Camera& camera = flat.model.cameras.at(CameraId(1));
  camera = testing::MakeTestCamera(CameraModel::kSimpleRadial);
  flat.map.planes.at(PlaneId(2)).extent = {{17.6, -20}, {17.6, 20}, {17.7, 0}};
  const auto folded = camera.ImageFromCamera(flat.image->cam_from_world * Vector3d(17.6, 0.0, 0.0));
  ASSERT_TRUE(folded);
  ASSERT_GT(folded->x(), 0.0);
  ASSERT_LT(folded->x(), 640.0);
  ASSERT_GT(folded->y(), 0.0);
  ASSERT_LT(folded->y(), 480.0);
  OverlayOptions options;
  options.axis_length = 0.0;  // One would run through that pixel.
  EXPECT_EQ(At(flat.Draw(options), *folded), kWhite);
}

TEST(Overlay, AxesLieInThePlane) {
  Flat flat;
  const double distance = (flat.image->cam_from_world * Vector3d(0.0, 0.0, 0.0)).norm();
  const PlanarSurface& plane = flat.map.planes.at(PlaneId(2));
  for (const Vector3d& axis : {plane.axis_u_in_world, plane.axis_v_in_world}) {
    OverlayOptions options;
    const Vector3d on_axis = 0.7 * options.axis_length * distance * axis;
    const auto xy =
        flat.model.cameras.at(CameraId(1)).ImageFromCamera(flat.image->cam_from_world * on_axis);
    const cv::Vec3b drawn = At(flat.Draw(options), *xy);  // Thin: smoothed with its dark rim.
    EXPECT_GT(drawn[2], 200);
    EXPECT_LT(drawn[0], 50);
    options.axis_length = 0.0;
    EXPECT_EQ(At(flat.Draw(options), *xy), kWhite);
  }
}

TEST(MapView, NearerPointsCoverFartherOnes) {
  const std::vector<ColoredPoint> points = {{{0, 0, 1}, {255, 0, 0}}, {{0, 0, 0}, {0, 255, 0}}};
  const ViewBounds bounds{{-1, -1}, {1, 1}};
  const cv::Mat top = DrawMapView(MapView::kTop, bounds, points, {}, 100);
  EXPECT_EQ(top.size(), cv::Size(100, 100));
  EXPECT_EQ(top.at<cv::Vec3b>(50, 50), cv::Vec3b(0, 0, 255));
  const cv::Mat side = DrawMapView(MapView::kSide, bounds, points, {}, 100);
  EXPECT_EQ(side.at<cv::Vec3b>(50, 50), cv::Vec3b(0, 255, 0));
  EXPECT_EQ(side.at<cv::Vec3b>(1, 50), cv::Vec3b(0, 0, 255));  // z = 1 is at the top.
}

TEST(MapView, AxesAreRightHandedRotations) {
  for (const MapView view : kMapViews) {
    const Eigen::Matrix3d axes = ViewAxes(view);
    EXPECT_NEAR(axes.determinant(), 1.0, 1e-12);
    EXPECT_TRUE((axes * axes.transpose()).isIdentity(1e-12));
    EXPECT_GE((axes * Vector3d::UnitZ()).y(), 0.0);  // Up is never down.
  }
}

TEST(MapView, StrayPointsDoNotShrinkTheMap) {
  std::vector<ColoredPoint> points;
  for (int i = 0; i < 1000; ++i) points.push_back({{i * 1e-3, i * 1e-3, 0.0}, {}});
  points.push_back({{1e6, -1e6, 0.0}, {}});
  const ViewBounds bounds = BoundsOfView(MapView::kTop, points, {});
  EXPECT_LT((bounds.max - bounds.min).maxCoeff(), 1.2);
  EXPECT_EQ(DrawMapView(MapView::kTop, bounds, points, {}, 60).cols, 60);
}

TEST(MapView, NoPointsAreAnEmptyPicture) {
  EXPECT_EQ(DrawMapView(MapView::kTop, BoundsOfView(MapView::kTop, {}, {}), {}, {}, 60).cols, 60);
}

}  // namespace
}  // namespace s3lam
