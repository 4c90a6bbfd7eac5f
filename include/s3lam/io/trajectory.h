#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "s3lam/scene/trajectory.h"

namespace s3lam {

/// TUM: "t tx ty tz qx qy qz qw", world_from_camera, # comments. Times must increase strictly.
/// Throws InputError naming source and line.
Trajectory ReadTumTrajectory(std::istream& stream, const std::string& source);
Trajectory ReadTumTrajectory(const std::filesystem::path& path);

/// KITTI: 12 numbers a line, 3x4 world_from_camera; times are the line numbers 0, 1, ..., or come
/// from `times` (one per pose).
Trajectory ReadKittiTrajectory(std::istream& stream, const std::string& source,
                               const std::vector<double>& times = {});

/// Reads either, told apart by the number of columns. The times of a KITTI trajectory come from the
/// times.txt beside it (one per pose [s]), if there is one.
Trajectory ReadTrajectory(const std::filesystem::path& path);

/// True for a KITTI trajectory without times beside it: it cannot be compared with one that has
/// times. Throws as ReadTrajectory.
bool IsTrajectoryWithoutTimes(const std::filesystem::path& path);

/// Throws InputError if one of two trajectories to be compared has times and the other has none.
void CheckBothHaveTimes(const std::filesystem::path& a, const std::filesystem::path& b);

/// Writes TUM with full precision, single spaces, and comment lines with the number of poses, by
/// which the reader notices a file that was cut short, and the names of the columns.
void WriteTumTrajectory(const Trajectory& trajectory, std::ostream& stream);
void WriteTumTrajectory(const Trajectory& trajectory, const std::filesystem::path& path);

}  // namespace s3lam
