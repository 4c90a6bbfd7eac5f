#include "s3lam/io/trajectory.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <cmath>
#include <sstream>

#include "line_parser.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

using internal::LineParser;
using internal::LineReader;

/// How far rounding may take a quaternion's norm, or a rotation matrix's entries, from a rotation.
constexpr double kRotationTolerance = 1e-2;

void Append(const TimedPose& pose, const LineParser& parser, Trajectory& trajectory) {
  if (!trajectory.empty() && pose.time_s <= trajectory.back().time_s) {
    parser.Fail("time {} is not after {} of the pose before", pose.time_s,
                trajectory.back().time_s);
  }
  trajectory.push_back(pose);
}

void CheckNotEmpty(const Trajectory& trajectory, const std::string& source) {
  if (trajectory.empty()) ThrowInputError("{}: no poses", source);
}

TimedPose ParseTumPose(LineParser& parser) {
  TimedPose pose;
  pose.time_s = parser.Real("time");
  for (double& coordinate : pose.world_from_camera.translation) {
    coordinate = parser.Real("translation");
  }
  Eigen::Quaterniond q;
  for (double& coefficient : q.coeffs()) coefficient = parser.Real("quaternion");  // x, y, z, w
  parser.ExpectEnd();
  if (std::abs(q.norm() - 1.0) > kRotationTolerance) {
    parser.Fail("the quaternion's norm is {}, not 1", q.norm());
  }
  // A quaternion that is unit to the last digits keeps its bits.
  pose.world_from_camera.rotation = std::abs(q.squaredNorm() - 1.0) > 1e-14 ? q.normalized() : q;
  return pose;
}

Rigid3 ParseKittiPose(LineParser& parser) {
  Eigen::Matrix<double, 3, 4> matrix;
  for (int row = 0; row < 3; ++row) {
    for (int col = 0; col < 4; ++col) matrix(row, col) = parser.Real("matrix entry");
  }
  parser.ExpectEnd();
  const Eigen::Matrix3d rotation = matrix.leftCols<3>();
  const Eigen::Matrix3d deviation = rotation.transpose() * rotation - Eigen::Matrix3d::Identity();
  if (deviation.cwiseAbs().maxCoeff() > kRotationTolerance || rotation.determinant() < 0.0) {
    parser.Fail("the left 3x3 block is not a rotation");
  }
  return {Eigen::Quaterniond(rotation).normalized(), matrix.col(3)};
}

constexpr int kKittiColumns = 12;

std::filesystem::path TimesBeside(const std::filesystem::path& trajectory) {
  return trajectory.parent_path() / "times.txt";
}

/// One time per line [s].
std::vector<double> ReadTimes(const std::filesystem::path& path) {
  std::istringstream stream(ReadFile(path));
  LineReader reader(stream, path.string());
  std::vector<double> times;
  while (reader.NextData()) {
    LineParser parser = reader.Parser();
    times.push_back(parser.Real("time"));
    parser.ExpectEnd();
  }
  return times;
}

/// Number of columns of the first line of data.
int NumColumns(const std::string& content, const std::string& source) {
  std::istringstream stream(content);
  LineReader reader(stream, source);
  if (!reader.NextData()) return 0;
  LineParser parser = reader.Parser();
  int count = 0;
  for (; !parser.AtEnd(); ++count) parser.Word("column");
  return count;
}

}  // namespace

Trajectory ReadTumTrajectory(std::istream& stream, const std::string& source) {
  LineReader reader(stream, source);
  internal::PromisedCount promised;
  Trajectory trajectory;
  while (reader.NextData(promised)) {
    LineParser parser = reader.Parser();
    Append(ParseTumPose(parser), parser, trajectory);
  }
  promised.Check(trajectory.size(), reader, "poses", source);
  CheckNotEmpty(trajectory, source);
  return trajectory;
}

Trajectory ReadTumTrajectory(const std::filesystem::path& path) {
  std::istringstream stream(ReadFile(path));
  return ReadTumTrajectory(stream, path.string());
}

Trajectory ReadKittiTrajectory(std::istream& stream, const std::string& source,
                               const std::vector<double>& times) {
  LineReader reader(stream, source);
  Trajectory trajectory;
  for (size_t i = 0; reader.NextData(); ++i) {
    LineParser parser = reader.Parser();
    if (!times.empty() && i >= times.size()) parser.Fail("more poses than the {} times", i);
    const double time_s = times.empty() ? static_cast<double>(i) : times[i];
    Append({time_s, ParseKittiPose(parser)}, parser, trajectory);
  }
  CheckNotEmpty(trajectory, source);
  if (!times.empty() && trajectory.size() != times.size()) {
    ThrowInputError("{}: {} poses for {} times", source, trajectory.size(), times.size());
  }
  return trajectory;
}

bool IsTrajectoryWithoutTimes(const std::filesystem::path& path) {
  return NumColumns(ReadFile(path), path.string()) == kKittiColumns &&
         !std::filesystem::exists(TimesBeside(path));
}

void CheckBothHaveTimes(const std::filesystem::path& a, const std::filesystem::path& b) {
  const bool a_has_none = IsTrajectoryWithoutTimes(a);
  if (a_has_none == IsTrajectoryWithoutTimes(b)) return;
  ThrowInputError(
      "{}: KITTI's poses have no times, but those of {} have: put the sequence's "
      "times.txt beside it",
      (a_has_none ? a : b).string(), (a_has_none ? b : a).string());
}

Trajectory ReadTrajectory(const std::filesystem::path& path) {
  const std::string source = path.string();
  const std::string content = ReadFile(path);
  const int num_columns = NumColumns(content, source);
  std::istringstream stream(content);
  if (num_columns == 0) ThrowInputError("{}: no poses", source);
  if (num_columns == 8) return ReadTumTrajectory(stream, source);
  if (num_columns == kKittiColumns) {
    const std::filesystem::path times = TimesBeside(path);
    return ReadKittiTrajectory(
        stream, source, std::filesystem::exists(times) ? ReadTimes(times) : std::vector<double>());
  }
  ThrowInputError("{}: {} columns; a TUM trajectory has 8, a KITTI trajectory 12", source,
                  num_columns);
}

void WriteTumTrajectory(const Trajectory& trajectory, std::ostream& stream) {
  // The count first, so that a file cut before it is not taken for one without it.
  stream << "# Number of poses: " << trajectory.size()
         << "\n# time_s tx ty tz qx qy qz qw (world_from_camera)\n";
  for (const TimedPose& pose : trajectory) {
    const Eigen::Vector3d& t = pose.world_from_camera.translation;
    const Eigen::Quaterniond& q = pose.world_from_camera.rotation;
    stream << fmt::format("{} {} {} {} {} {} {} {}\n", pose.time_s, t.x(), t.y(), t.z(), q.x(),
                          q.y(), q.z(), q.w());
  }
}

void WriteTumTrajectory(const Trajectory& trajectory, const std::filesystem::path& path) {
  WriteFile(path, [&](std::ostream& stream) { WriteTumTrajectory(trajectory, stream); });
}

}  // namespace s3lam
