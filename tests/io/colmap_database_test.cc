#include "s3lam/io/colmap_database.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <cstring>

#include "s3lam/io/file.h"
#include "support/temp_dir.h"
#include "support/test_scene.h"

namespace s3lam {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// Rows of a query, as text and bytes.
std::vector<std::vector<std::string>> Query(const std::filesystem::path& path, const char* sql) {
  sqlite3* database = nullptr;
  sqlite3_stmt* statement = nullptr;
  EXPECT_EQ(sqlite3_open(path.c_str(), &database), SQLITE_OK);
  EXPECT_EQ(sqlite3_prepare_v2(database, sql, -1, &statement, nullptr), SQLITE_OK);
  std::vector<std::vector<std::string>> rows;
  while (sqlite3_step(statement) == SQLITE_ROW) {
    std::vector<std::string> row;
    for (int c = 0; c < sqlite3_column_count(statement); ++c) {
      const auto* bytes = static_cast<const char*>(sqlite3_column_blob(statement, c));
      row.emplace_back(bytes, static_cast<size_t>(sqlite3_column_bytes(statement, c)));
    }
    rows.push_back(std::move(row));
  }
  sqlite3_finalize(statement);
  sqlite3_close(database);
  return rows;
}

template <typename T>
std::vector<T> Numbers(const std::string& bytes) {
  std::vector<T> numbers(bytes.size() / sizeof(T));
  std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(T));
  return numbers;
}

class ColmapDatabase : public ::testing::Test {
 protected:
  ColmapDatabase() { WriteColmapDatabase(scene_, path_); }

  Reconstruction scene_ = testing::MakeTestScene({.noise_px = 0.0});
  testing::TempDir dir_;
  std::filesystem::path path_ = dir_ / "database.db";
};

TEST_F(ColmapDatabase, HasTheKeypointsOfAllImages) {
  const auto rows = Query(path_,
                          "SELECT name, rows, data FROM images NATURAL JOIN keypoints "
                          "ORDER BY image_id");
  ASSERT_EQ(rows.size(), scene_.images.size());
  auto row = rows.begin();
  for (const auto& [id, image] : scene_.images) {
    EXPECT_EQ((*row)[0], image.name);
    EXPECT_EQ((*row)[1], std::to_string(image.points2D.size()));
    const auto xy = Numbers<float>((*row)[2]);
    ASSERT_EQ(xy.size(), 2 * image.points2D.size());
    for (size_t i = 0; i < image.points2D.size(); ++i) {
      EXPECT_EQ(xy[2 * i], static_cast<float>(image.points2D[i].xy.x()));
      EXPECT_EQ(xy[2 * i + 1], static_cast<float>(image.points2D[i].xy.y()));
    }
    ++row;
  }
}

TEST_F(ColmapDatabase, MatchesSeeTheSamePointAndObeyTheGeometry) {
  const auto rows = Query(path_, "SELECT pair_id, data, F, config FROM two_view_geometries");
  EXPECT_EQ(Query(path_, "SELECT 1 FROM matches").size(), rows.size());
  ASSERT_GT(rows.size(), 5U);
  for (const auto& row : rows) {
    const uint64_t pair = std::stoull(row[0]);
    const Image& a = scene_.images.at(ImageId(static_cast<uint32_t>(pair / 2147483647)));
    const Image& b = scene_.images.at(ImageId(static_cast<uint32_t>(pair % 2147483647)));
    EXPECT_LT(a.id, b.id);
    EXPECT_EQ(row[3], "2");
    const auto matches = Numbers<uint32_t>(row[1]);
    const auto values = Numbers<double>(row[2]);
    ASSERT_EQ(values.size(), 9U);
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> fundamental(values.data());
    for (size_t i = 0; i < matches.size(); i += 2) {
      const Point2D& in_a = a.points2D.at(matches[i]);
      const Point2D& in_b = b.points2D.at(matches[i + 1]);
      EXPECT_TRUE(in_a.point_id.valid());
      EXPECT_EQ(in_a.point_id, in_b.point_id);
      const Eigen::Vector3d line = fundamental * in_a.xy.homogeneous();
      EXPECT_LT(std::abs(line.dot(in_b.xy.homogeneous())), 1e-6 * line.head<2>().norm());
    }
  }
}

TEST_F(ColmapDatabase, TheSameModelGivesTheSameBytes) {
  WriteColmapDatabase(scene_, dir_ / "again.db");
  EXPECT_EQ(ReadFile(path_), ReadFile(dir_ / "again.db"));
}

TEST_F(ColmapDatabase, WhatIsThereIsReplaced) {
  dir_.Write("again.db", "something else");
  WriteColmapDatabase(scene_, dir_ / "again.db");
  EXPECT_EQ(ReadFile(path_), ReadFile(dir_ / "again.db"));
}

TEST_F(ColmapDatabase, ErrorsNameThePathAndTheReason) {
  EXPECT_THAT([&] { WriteColmapDatabase(scene_, dir_ / "missing" / "database.db"); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("missing/database.db"), HasSubstr("No such file"))));
  // Larger than pairs of images can be numbered.
  Image image = scene_.images.begin()->second;
  image.id = ImageId(2147483647);
  image.name = "last.png";
  scene_.images.emplace(image.id, image);
  EXPECT_THAT([&] { WriteColmapDatabase(scene_, path_); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr(path_.string()), HasSubstr("image_id_check"))));
}

}  // namespace
}  // namespace s3lam
