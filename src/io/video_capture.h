#pragma once

#include <filesystem>
#include <opencv2/videoio.hpp>

namespace s3lam::internal {

/// Opens the file with the first of OpenCV's backends that can, in OpenCV's order, but with none
/// that looks for attached cameras: left to itself, OpenCV has those search the USB bus for a file
/// that is no video. False if no backend opens it.
bool OpenVideoFile(const std::filesystem::path& path, cv::VideoCapture& capture);

}  // namespace s3lam::internal
