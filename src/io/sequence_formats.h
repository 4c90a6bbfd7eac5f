#pragma once

#include <filesystem>
#include <string>

#include "s3lam/io/image_sequence.h"

/// The formats of OpenSequence, one function each. They list all frames and set the format's own
/// camera, if it brings one; camera.json, frame range and checks common to all come after.
namespace s3lam::internal {

/// Frame period of images whose times nobody tells [s].
inline constexpr double kDefaultPeriodS = 1.0 / 30.0;

bool IsTumSequence(const std::filesystem::path& path);
bool IsKittiSequence(const std::filesystem::path& path);
bool IsKittiRawSequence(const std::filesystem::path& path);
bool IsEurocSequence(const std::filesystem::path& path);

ImageSequence OpenTum(const std::filesystem::path& path);
ImageSequence OpenKitti(const std::filesystem::path& path, OwnCamera camera);
ImageSequence OpenKittiRaw(const std::filesystem::path& path, OwnCamera camera);
ImageSequence OpenEuroc(const std::filesystem::path& path, OwnCamera camera);
/// `period_s` is the time from one image to the next.
ImageSequence OpenFolder(const std::filesystem::path& path, double period_s);

/// Image files below a folder, relative to it, in natural order ("frame9" before "frame10").
std::vector<std::string> ListImages(const std::filesystem::path& directory, bool recursive);

}  // namespace s3lam::internal
