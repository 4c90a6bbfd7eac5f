#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>

#include "s3lam/scene/frame_observations.h"

namespace s3lam {

/// observations.bin, little endian: "S3OBSV01", uint64 number of frames, then each frame: float64
/// time, uint32 camera id, uint64 number of observations, each (uint64 point id, float32 x, y,
/// sigma). Throws InputError naming the source on a wrong magic, a cut file, a count that does not
/// fit, times that do not increase, and numbers that are not finite or sigmas that are not
/// positive.
FrameObservations ReadFrameObservations(std::istream& stream, const std::string& source);
FrameObservations ReadFrameObservations(const std::filesystem::path& path);
void WriteFrameObservations(const FrameObservations& frames, std::ostream& stream);
void WriteFrameObservations(const FrameObservations& frames, const std::filesystem::path& path);

}  // namespace s3lam
