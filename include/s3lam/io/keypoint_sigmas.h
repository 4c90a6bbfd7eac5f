#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>

#include "s3lam/scene/keypoint_sigmas.h"
#include "s3lam/scene/reconstruction.h"

namespace s3lam {

/// keypoint_sigmas.bin, little endian: "S3KSIG01", uint64 number of images, then each image: uint32
/// image id, uint64 number of keypoints, float32 standard deviations [px]. Throws InputError naming
/// the source on a wrong magic, a cut file, a count that does not fit, ids that do not increase and
/// sigmas that are not positive and finite.
KeypointSigmas ReadKeypointSigmas(std::istream& stream, const std::string& source);
KeypointSigmas ReadKeypointSigmas(const std::filesystem::path& path);
void WriteKeypointSigmas(const KeypointSigmas& sigmas, std::ostream& stream);
void WriteKeypointSigmas(const KeypointSigmas& sigmas, const std::filesystem::path& path);

/// Throws InputError unless every image of the model has as many sigmas as keypoints.
void CheckKeypointSigmas(const KeypointSigmas& sigmas, const Reconstruction& model,
                         const std::string& source);

}  // namespace s3lam
