#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "s3lam/scene/constraints.h"
#include "s3lam/scene/reconstruction.h"

namespace s3lam {

/// {"images": ["name", ...], "points": [id, ...]}: what stays as it is; "all" in the place of a
/// list means every image, every point. And {"plane_distances": [{"planes": [id, id], "distance":
/// d, "sigma": s}, ...]}: parallel planes, by their ids in the semantic map, that are known to be d
/// apart [map units]. Each may be left out. Throws InputError naming the file for unknown keys, for
/// images and points that the model does not have, and for distances and sigmas that are not
/// positive.
void ReadConstantParts(const std::filesystem::path& path, const Reconstruction& model,
                       Constraints& constraints);

/// Pose priors in the model's world or another: lines "t tx ty tz qx qy qz qw sigma_position
/// sigma_rotation" (TUM, world_from_camera, and two standard deviations in units of that world and
/// degrees; 0: not known), # comments. In the place of the time t an image's name may stand; times
/// are looked up in `image_times_s` (one per image in ascending id, may be empty) to a millisecond.
/// Throws InputError naming source and line.
void ReadPosePriors(std::istream& stream, const std::string& source, const Reconstruction& model,
                    const std::vector<double>& image_times_s, Constraints& constraints);
void ReadPosePriors(const std::filesystem::path& path, const Reconstruction& model,
                    const std::vector<double>& image_times_s, Constraints& constraints);

}  // namespace s3lam
