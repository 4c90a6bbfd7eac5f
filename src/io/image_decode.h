#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <string_view>

namespace s3lam::internal {

/// Decodes the bytes of an image file with OpenCV's imread flags, without the EXIF orientation.
/// Throws InputError naming `source` if they are no image, damaged, cut short, or so few that the
/// image cannot have the size that its header claims; std::runtime_error if memory does not
/// suffice.
cv::Mat DecodeImage(std::string_view bytes, int imread_flags, const std::string& source);

}  // namespace s3lam::internal
