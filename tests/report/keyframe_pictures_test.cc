#include "s3lam/report/keyframe_pictures.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "s3lam/base/error.h"
#include "support/temp_dir.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using ::testing::ElementsAre;
using testing::TempDir;

/// Images 1 to 5 in a sub-folder, of one camera, with nothing in them.
Reconstruction FiveImages() {
  Reconstruction model;
  model.cameras[CameraId(1)] = testing::MakeTestCamera(CameraModel::kSimplePinhole);
  for (uint32_t i = 1; i <= 5; ++i) {
    Image& image = model.images[ImageId(i)];
    image.id = ImageId(i);
    image.camera_id = CameraId(1);
    image.name = "cam0/" + std::to_string(i) + ".jpg";
  }
  return model;
}

std::vector<uint32_t> Selected(const std::string& selection) {
  const Reconstruction model = FiveImages();
  std::vector<uint32_t> ids;
  for (const Image* image : SelectImages(model, selection)) ids.push_back(image->id.value());
  return ids;
}

TEST(SelectImages, TakesNumbersAllAndNames) {
  EXPECT_THAT(Selected("0"), ElementsAre());
  EXPECT_THAT(Selected("3"), ElementsAre(1, 3, 5));
  EXPECT_THAT(Selected("99"), ElementsAre(1, 2, 3, 4, 5));
  EXPECT_THAT(Selected("all"), ElementsAre(1, 2, 3, 4, 5));
  EXPECT_THAT(Selected("cam0/4.jpg,cam0/2.jpg"), ElementsAre(4, 2));
  EXPECT_THROW(Selected("cam0/6.jpg"), InputError);
  EXPECT_THROW(Selected("-1"), InputError);
}

TEST(WriteKeyframePictures, WritesOnePerImage) {
  const TempDir dir;
  const Reconstruction model = FiveImages();
  const Camera& camera = model.cameras.at(CameraId(1));
  const cv::Mat grey(camera.height, camera.width, CV_8UC1, cv::Scalar(77));
  std::filesystem::create_directories(dir / "images/cam0");
  cv::imwrite((dir / "images/cam0/2.jpg").string(), grey);
  const auto images = SelectImages(model, "cam0/2.jpg");
  WriteKeyframePictures(model, SemanticMap{}, images, dir / "images", 1, dir / "out");
  const cv::Mat picture = cv::imread((dir / "out/cam0/2.jpg.png").string());
  ASSERT_EQ(picture.size(), grey.size());
  EXPECT_EQ(picture.at<cv::Vec3b>(5, 5), cv::Vec3b(77, 77, 77));
  EXPECT_THROW(WriteKeyframePictures(model, SemanticMap{}, SelectImages(model, "cam0/3.jpg"),
                                     dir / "images", 1, dir / "out"),
               InputError);
  cv::imwrite((dir / "images/cam0/2.jpg").string(), grey.rowRange(0, 100));
  EXPECT_THROW(WriteKeyframePictures(model, SemanticMap{}, images, dir / "images", 1, dir / "out"),
               InputError);
}

}  // namespace
}  // namespace s3lam
