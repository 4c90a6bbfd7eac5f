#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>

#include "s3lam/base/error.h"
#include "s3lam/io/semantic_map_io.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::HasSubstr;

std::string ErrorOf(const std::string& json) {
  const testing::TempDir dir;
  try {
    (void)ReadClassTable(dir.Write("table.json", json));
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

ClassTable ReadConfig(const std::string& name) {
  return ReadClassTable(std::filesystem::path(S3LAM_TEST_SOURCE_DIR) / "configs/classes" / name);
}

const SemanticClass& Get(const ClassTable& table, int id) {
  return table.classes.at(static_cast<size_t>(table.IndexOfId(id).value()));
}

TEST(ClassTable, CocoHasAllPanopticClasses) {
  const ClassTable table = ReadConfig("coco.json");
  EXPECT_EQ(table.size(), 133);
  const auto is_thing = [](const SemanticClass& c) { return c.is_thing; };
  EXPECT_EQ(std::count_if(table.classes.begin(), table.classes.end(), is_thing), 80);
  EXPECT_EQ(Get(table, 1).name, "person");
  EXPECT_TRUE(Get(table, 1).is_dynamic);
  EXPECT_EQ(Get(table, 200).name, "rug-merged");
  EXPECT_TRUE(Get(table, 76).is_planar);
  EXPECT_EQ(Get(table, 76).min_plane_inliers, 50);
  EXPECT_EQ(Get(table, 190).orientation, SurfaceOrientation::kHorizontal);
  EXPECT_EQ(Get(table, 199).orientation, SurfaceOrientation::kVertical);
  for (const int never : {133, 148, 155, 178, 62, 47}) EXPECT_FALSE(Get(table, never).is_planar);
}

TEST(ClassTable, CityscapesHasTheTrainIds) {
  const ClassTable table = ReadConfig("cityscapes.json");
  EXPECT_EQ(table.size(), 19);
  EXPECT_EQ(Get(table, 0).name, "road");
  EXPECT_TRUE(Get(table, 0).is_planar);
  EXPECT_EQ(Get(table, 13).name, "car");
  EXPECT_TRUE(Get(table, 13).is_thing);
  EXPECT_TRUE(Get(table, 13).is_dynamic);
}

TEST(ClassTable, Ade20kAndNyu40CountFromOne) {
  const ClassTable ade = ReadConfig("ade20k.json");
  EXPECT_EQ(ade.size(), 150);
  EXPECT_EQ(Get(ade, 1).name, "wall");
  EXPECT_EQ(Get(ade, 29).name, "rug");
  EXPECT_EQ(Get(ade, 29).orientation, SurfaceOrientation::kHorizontal);
  EXPECT_EQ(Get(ade, 145).name, "bulletin board");
  EXPECT_TRUE(Get(ade, 13).is_dynamic);
  EXPECT_FALSE(Get(ade, 28).is_planar);  // Mirror.
  const ClassTable nyu = ReadConfig("nyu40.json");
  EXPECT_EQ(nyu.size(), 40);
  EXPECT_EQ(Get(nyu, 22).name, "ceiling");
  EXPECT_EQ(Get(nyu, 30).name, "whiteboard");
  EXPECT_EQ(Get(nyu, 8).orientation, SurfaceOrientation::kVertical);
  EXPECT_TRUE(Get(nyu, 31).is_dynamic);
  EXPECT_FALSE(Get(nyu, 19).is_planar);  // Mirror.
}

TEST(ClassTable, SortsByIdAndFillsDefaults) {
  const testing::TempDir dir;
  const ClassTable table = ReadClassTable(dir.Write("t.json", R"({"name": "t", "classes": [
    {"id": 9, "name": "b", "thing": true, "planar": false, "dynamic": true, "color": [1, 2, 3]},
    {"id": 4, "name": "a", "thing": false, "planar": true, "dynamic": false, "color": [4, 5, 6],
     "min_plane_inliers": 12, "orientation": "vertical"}]})"));
  ASSERT_EQ(table.size(), 2);
  EXPECT_EQ(table.classes[0].id, 4);
  EXPECT_EQ(table.classes[0].min_plane_inliers, 12);
  EXPECT_EQ(table.classes[0].orientation, SurfaceOrientation::kVertical);
  EXPECT_EQ(table.classes[1].min_plane_inliers, SemanticClass{}.min_plane_inliers);
  EXPECT_EQ(table.classes[1].color, (Rgb{1, 2, 3}));
}

TEST(ClassTable, NamesWhatIsWrong) {
  const std::string sound =
      R"("id": 1, "name": "a", "thing": true, "planar": true, "dynamic": true, "color": [1, 2, 3])";
  const auto error = [&](const std::string& more) {
    return ErrorOf(R"({"name": "t", "classes": [{)" + sound + more + "}]}");
  };
  EXPECT_EQ(error(""), "");
  EXPECT_THAT(error(R"(, "planer": true)"), HasSubstr("did you mean 'planar'"));
  EXPECT_THAT(error(R"(, "orientation": "slanted")"), HasSubstr("orientation 'slanted'"));
  EXPECT_THAT(error(R"(, "min_plane_inliers": 2)"), HasSubstr("'min_plane_inliers' is below 3"));
  EXPECT_THAT(error(R"(}, {)" + sound), HasSubstr("class id 1 is there twice"));
  EXPECT_THAT(ErrorOf(R"({"name": "t", "classes": []})"), HasSubstr("is empty"));
  EXPECT_THAT(ErrorOf(R"({"name": "t"})"), HasSubstr("'classes' is missing"));
  EXPECT_THAT(ErrorOf(R"({"name": "t", "classes": [{"id": 1}]})"), HasSubstr("classes[0]"));
  EXPECT_THAT(ErrorOf(R"({"name": "t", "classes": [{"id": "1"}]})"), HasSubstr("'id' is not an"));
}

}  // namespace
}  // namespace s3lam
