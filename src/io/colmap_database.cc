#include "s3lam/io/colmap_database.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <Eigen/Core>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "s3lam/io/file.h"

namespace s3lam {
namespace {

using PairOfImages = std::pair<ImageId, ImageId>;  // Ascending.
using Match = std::array<uint32_t, 2>;             // Keypoints of the first and of the second.
using Matrix3dRow = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr int kCalibrated = 2;                // TwoViewGeometry::CALIBRATED
constexpr uint64_t kMaxImageId = 2147483647;  // Pairs are numbered by it.

// As `colmap database_creator` makes them. A file that nobody else sees and that is thrown away if
// writing fails needs no journal; flushing is the caller's.
constexpr const char* kSchema = R"(
PRAGMA journal_mode = OFF;
PRAGMA synchronous = OFF;
PRAGMA user_version = 3800;
BEGIN;
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  model INTEGER NOT NULL, width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB,
  prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  name TEXT NOT NULL UNIQUE, camera_id INTEGER NOT NULL,
  prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL,
  prior_tx REAL, prior_ty REAL, prior_tz REAL,
  CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
  FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL,
  F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB);
)";

/// An SQLite file being written, in one transaction that Commit() ends.
class Database {
 public:
  explicit Database(const std::filesystem::path& path) : path_(path.string()) {
    WriteFile(path, [](std::ostream&) {});  // SQLite goes on with an empty file.
    sqlite3* handle = nullptr;
    // Without locks, which some network file systems do not have.
    const int result = sqlite3_open_v2(path_.c_str(), &handle, SQLITE_OPEN_READWRITE, "unix-none");
    handle_.reset(handle);
    Check(result);
    Execute(kSchema);
  }

  void Commit() { Execute("COMMIT"); }

  [[nodiscard]] sqlite3* handle() const { return handle_.get(); }

  void Check(int result) const {
    if (result == SQLITE_OK || result == SQLITE_DONE) return;
    throw std::runtime_error(fmt::format("{}: cannot write: {}", path_, Reason(result)));
  }

 private:
  /// The system's reason if there is one, as for other files, else SQLite's.
  [[nodiscard]] const char* Reason(int result) const {
    if (!handle_) return sqlite3_errstr(result);
    int error = 0;
    sqlite3_file_control(handle_.get(), "main", SQLITE_FCNTL_LAST_ERRNO, &error);
    if (result == SQLITE_FULL) error = ENOSPC;
    return error != 0 ? std::strerror(error) : sqlite3_errmsg(handle_.get());
  }

  void Execute(const char* sql) {
    Check(sqlite3_exec(handle_.get(), sql, nullptr, nullptr, nullptr));
  }

  struct Close {
    void operator()(sqlite3* handle) const { sqlite3_close(handle); }
  };
  std::string path_;
  std::unique_ptr<sqlite3, Close> handle_;
};

/// An INSERT whose values are bound from left to right, row after row.
class Insertion {
 public:
  Insertion(const Database& database, const char* sql) : database_(database) {
    sqlite3_stmt* statement = nullptr;
    const int result = sqlite3_prepare_v2(database.handle(), sql, -1, &statement, nullptr);
    statement_.reset(statement);
    database.Check(result);
  }

  Insertion& Integer(uint64_t value) {
    database_.Check(
        sqlite3_bind_int64(statement_.get(), ++place_, static_cast<sqlite3_int64>(value)));
    return *this;
  }
  Insertion& Text(const std::string& value) {
    database_.Check(sqlite3_bind_text64(statement_.get(), ++place_, value.data(), value.size(),
                                        SQLITE_TRANSIENT, SQLITE_UTF8));
    return *this;
  }
  Insertion& Blob(std::span<const std::byte> bytes) {
    // Not a null pointer, which would bind NULL.
    const void* data = bytes.empty() ? static_cast<const void*>("") : bytes.data();
    database_.Check(
        sqlite3_bind_blob64(statement_.get(), ++place_, data, bytes.size(), SQLITE_TRANSIENT));
    return *this;
  }
  void Run() {
    database_.Check(sqlite3_step(statement_.get()));
    database_.Check(sqlite3_reset(statement_.get()));
    place_ = 0;
  }

 private:
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  const Database& database_;
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  int place_ = 0;
};

void InsertCameras(const Reconstruction& reconstruction, const Database& database) {
  Insertion insertion(database, "INSERT INTO cameras VALUES (?, ?, ?, ?, ?, 1)");
  for (const auto& [id, camera] : reconstruction.cameras) {
    insertion.Integer(id.value())
        .Integer(static_cast<uint64_t>(camera.model))
        .Integer(static_cast<uint64_t>(camera.width))
        .Integer(static_cast<uint64_t>(camera.height))
        .Blob(std::as_bytes(std::span(camera.params)))
        .Run();
  }
}

void InsertImages(const Reconstruction& reconstruction, const Database& database) {
  Insertion image_insertion(database,
                            "INSERT INTO images (image_id, name, camera_id) VALUES (?, ?, ?)");
  Insertion keypoint_insertion(database, "INSERT INTO keypoints VALUES (?, ?, 2, ?)");
  for (const auto& [id, image] : reconstruction.images) {
    image_insertion.Integer(id.value()).Text(image.name).Integer(image.camera_id.value()).Run();
    std::vector<std::array<float, 2>> keypoints;
    for (const Point2D& point2D : image.points2D) {
      keypoints.push_back({static_cast<float>(point2D.xy.x()), static_cast<float>(point2D.xy.y())});
    }
    keypoint_insertion.Integer(id.value())
        .Integer(keypoints.size())
        .Blob(std::as_bytes(std::span(keypoints)))
        .Run();
  }
}

/// Between every two images the keypoints that see the same point, by the points' ids.
std::map<PairOfImages, std::vector<Match>> MatchesOf(const Reconstruction& reconstruction) {
  std::map<PairOfImages, std::vector<Match>> matches;
  for (const auto& [id, point] : reconstruction.points) {
    for (const TrackElement& a : point.track) {
      for (const TrackElement& b : point.track) {
        if (a.image_id < b.image_id) {
          matches[{a.image_id, b.image_id}].push_back({a.point2D_index, b.point2D_index});
        }
      }
    }
  }
  return matches;
}

Eigen::Matrix3d InverseCalibration(const Camera& camera) {
  Eigen::Matrix3d inverse = Eigen::Matrix3d::Identity();
  inverse(0, 0) = 1.0 / camera.FocalX();
  inverse(1, 1) = 1.0 / camera.FocalY();
  inverse(0, 2) = -camera.PrincipalX() / camera.FocalX();
  inverse(1, 2) = -camera.PrincipalY() / camera.FocalY();
  return inverse;
}

/// The relative pose b_from_a = (R, t) and what follows from it, as columns of a row: E = [t]x R,
/// F = K_b^-T E K_a^-1 of undistorted pixels, H = 0.
void BindGeometry(const Reconstruction& reconstruction, const PairOfImages& pair,
                  Insertion& insertion) {
  const Image& a = reconstruction.images.at(pair.first);
  const Image& b = reconstruction.images.at(pair.second);
  const Rigid3 b_from_a = b.cam_from_world * a.cam_from_world.Inverse();
  const Eigen::Quaterniond& q = b_from_a.rotation;
  const Eigen::Vector3d& t = b_from_a.translation;
  const Matrix3dRow essential = CrossMatrix(t) * q.toRotationMatrix();
  const Matrix3dRow fundamental = InverseCalibration(reconstruction.CameraOf(b)).transpose() *
                                  essential * InverseCalibration(reconstruction.CameraOf(a));
  const Matrix3dRow homography = Matrix3dRow::Zero();
  for (const Matrix3dRow& matrix : {fundamental, essential, homography}) {
    insertion.Blob(std::as_bytes(std::span(matrix.data(), 9)));
  }
  const std::array<double, 4> quaternion{q.w(), q.x(), q.y(), q.z()};
  insertion.Blob(std::as_bytes(std::span(quaternion)));
  insertion.Blob(std::as_bytes(std::span(t.data(), 3)));
}

void InsertPairs(const Reconstruction& reconstruction, const Database& database) {
  Insertion match_insertion(database, "INSERT INTO matches VALUES (?, ?, 2, ?)");
  Insertion geometry_insertion(
      database, "INSERT INTO two_view_geometries VALUES (?, ?, 2, ?, ?, ?, ?, ?, ?, ?)");
  for (const auto& [pair, matches] : MatchesOf(reconstruction)) {
    const uint64_t pair_id = kMaxImageId * pair.first.value() + pair.second.value();
    const auto data = std::as_bytes(std::span(matches));
    match_insertion.Integer(pair_id).Integer(matches.size()).Blob(data).Run();
    geometry_insertion.Integer(pair_id).Integer(matches.size()).Blob(data).Integer(kCalibrated);
    BindGeometry(reconstruction, pair, geometry_insertion);
    geometry_insertion.Run();
  }
}

}  // namespace

void WriteColmapDatabase(const Reconstruction& reconstruction, const std::filesystem::path& path) {
  Database database(path);
  InsertCameras(reconstruction, database);
  InsertImages(reconstruction, database);
  InsertPairs(reconstruction, database);
  database.Commit();
}

}  // namespace s3lam
